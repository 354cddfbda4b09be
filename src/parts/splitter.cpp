#include "parts/splitter.h"

#include <xxhash.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <set>
#include <system_error>
#include <vector>

#include "parts/grid_use.h"
#include "parts/manifest_hash.h"
#include "parts/part_builder.h"
#include "parts/part_maker.h"
#include "parts/partition.h"
#include "parts/scene_files.h"
#include "parts/scene_spool.h"
#include "parts/specular_boxes.h"
#include "parts/text.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

// A shape belongs to the main scene when its box has more than this share of the scene's surface
// and it is cheap.
constexpr float kLargeShare = 0.1f;
constexpr float kCheapBytes = 64 << 10;
constexpr double kAllCheapBytes = 16 << 20;  // of all such shapes
constexpr double kEmissiveBytes = 64 << 20;
// A sky sphere hides that a ground plane is large. When all large shapes together leave less than
// this share of the surface, the rule is applied again to what is left.
constexpr float kShrinks = 0.25f;
// Copies of a vertex at the borders of parts come on top of the prediction.
constexpr double kFill = 0.97;
// Of a part with triangles only, which most are.
constexpr std::uint64_t kFixedBytes = loaded_bytes::kSceneObject + loaded_bytes::bvh_base(kNone);
// A prototype up to this many parts large is one blob.
constexpr double kLargePrototype = 4;
// Objects inside objects are copied up to this size, whatever the part size is: copying rounds.
constexpr double kFlattenBytes = 64 << 20;

std::string scratch_folder(const std::string& out, const SplitOptions& options) {
  return options.scratch.empty() ? out : options.scratch;
}

// A folder is an earlier split, complete or not, when it has one of these. Only then anything is
// removed from it.
constexpr const char* kManifest = "manifest.bin";
constexpr const char* kUnfinished = "manifest.tmp";

void prepare_folder(const fs::path& folder, bool text) {
  fs::create_directories(folder);
  const bool earlier = fs::exists(folder / kManifest) || fs::exists(folder / kUnfinished);
  if (!earlier && text && fs::exists(folder / "main.pbrt"))
    throw UsageError((folder / "main.pbrt").string() + " is there and does not come from a split");
  std::ofstream(folder / kUnfinished).flush();
  fs::remove(folder / kManifest);
  if (earlier) fs::remove(folder / "main.pbrt");
  for (const char* sub : {"parts", "prototypes"}) {
    fs::create_directories(folder / sub);
    if (!earlier) continue;
    for (const fs::directory_entry& e : fs::directory_iterator(folder / sub)) {
      const std::string stem = e.path().stem().string(), extension = e.path().extension().string();
      const bool numbered = stem.find_first_not_of("0123456789") == std::string::npos;
      if (numbered && (extension == ".part" || extension == ".pbrt")) fs::remove(e.path());
    }
  }
}

// Written under another name first: a split folder is complete or has no manifest.
void write_manifest(const std::string& folder, const std::string& bytes) {
  const fs::path temporary = fs::path(folder) / kUnfinished;
  std::ofstream file(temporary, std::ios::binary);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file.close();
  if (!file) throw std::system_error(errno, std::generic_category(), temporary.string());
  fs::rename(temporary, fs::path(folder) / kManifest);
}

}  // namespace

class SceneSplitter::Work {
 public:
  Work(const std::string& out, const SplitOptions& options, Warnings& warnings)
      : out_(out),
        options_(options),
        warnings_(warnings),
        scratch_(scratch_folder(out, options)),
        scene_(scratch_,
               std::min(kFlattenBytes, static_cast<double>(options.large_object)),
               warnings),
        records_(scratch_),
        motions_(scratch_),
        items_(scratch_) {}

  SceneSink& sink() { return scene_; }
  Manifest finish(SceneDescription description);

 private:
  // What an instance of a prototype becomes: an instance of each piece.
  struct Piece {
    std::uint32_t blob = 0;
    std::uint32_t first_shape = 0;
    Placing to_object;
  };

  bool is_interface(const ShapeRow& row) const;
  bool is_lifted(std::uint32_t row) const { return row < lifted_.size() && lifted_[row]; }
  void lift_interfaces();
  void lift(const Spool::View& view, std::uint32_t prototype, const Transform& to_world,
            std::uint32_t first_shape);
  void write_prototypes();
  void write_prototype(std::uint32_t index);
  void move_into_world(std::uint32_t index);
  void expand_instances();
  void add_bricks();
  std::vector<std::uint32_t> choose_main_scene();
  void write_main_scene(const std::vector<std::uint32_t>& rows);
  void write_world();
  bool write_part(std::span<Item> items, PartMaker& maker, bool accept_any);
  PartMaker maker() {
    return {scene_.spool().map(), records_.map(), motions_.map(), scene_.grids().map(), options_.memory / 4};
  }
  // Room for triangles, quadrics and instances: less the largest fixed cost, as far as the size
  // allows.
  double capacity() const {
    const auto size = static_cast<double>(options_.part_size);
    return std::max(size / 2, kFill * size - static_cast<double>(kFixedBytes));
  }

  std::string out_;
  SplitOptions options_;
  Warnings& warnings_;
  std::string scratch_;
  SceneSpool scene_;
  SpoolArray<InstanceRecord> records_;      // instances of blobs in the world
  SpoolArray<MotionRecord> motions_;        // of those that move
  SpoolArray<Item> items_;                  // instances and bricks first, then triangles and quadrics
  std::vector<std::vector<Piece>> pieces_;  // by prototype as read
  std::vector<bool> in_main_;               // by row
  std::vector<bool> lifted_;                // by row as read: of objects, and now of the world
  std::vector<std::uint64_t> checksums_;
  std::vector<std::uint32_t> prototype_features_;
  Bounds3 instance_box_;  // and of the bricks
  Manifest manifest_;
};

Manifest SceneSplitter::Work::finish(SceneDescription description) {
  manifest_.scene = std::move(description);
  manifest_.shape_lights = scene_.shape_lights();
  manifest_.specular_boxes = specular_boxes(manifest_.scene, scene_);
  lift_interfaces();
  write_prototypes();
  expand_instances();
  add_bricks();
  write_main_scene(choose_main_scene());
  write_world();

  Warnings untold;
  checksums_.push_back(collect_files(manifest_.scene, out_, options_.tells_missing_files ? warnings_ : untold));
  checksums_.push_back(manifest_hash(manifest_));
  manifest_.content_hash =
      XXH3_64bits(checksums_.data(), checksums_.size() * sizeof(std::uint64_t));
  if (options_.text) write_text(out_, manifest_);
  write_manifest(out_, encode(manifest_));
  make_file_names_absolute(manifest_.scene, out_);
  return std::move(manifest_);
}

// A surface that a shadow ray passes: every host finds for itself what media lie along it.
bool SceneSplitter::Work::is_interface(const ShapeRow& row) const {
  const SceneDescription& scene = manifest_.scene;
  return scene.dialect == Dialect::v3 && !scene.media.empty() && row.material < scene.materials.size() &&
         scene.materials[row.material].type == "none";
}

// Interfaces of objects that stand still become shapes of the world, since only those let shadow
// rays pass.
void SceneSplitter::Work::lift_interfaces() {
  if (manifest_.scene.media.empty()) return;
  const std::vector<PrototypeSpool>& prototypes = scene_.prototypes();
  const std::span<const InstanceRecord> instances = scene_.instances().map();
  std::vector<double> uses(prototypes.size(), 0);
  std::vector<bool> moves(prototypes.size());
  for (const InstanceRecord& i : instances) ++uses[i.prototype];
  for (const MotionRecord& m : scene_.motions().map()) moves[instances[m.instance].prototype] = true;
  for (std::size_t p = prototypes.size(); p-- > 0;)
    for (const PrototypeSpool::Nested& n : prototypes[p].nested) {
      uses[n.prototype] += uses[p];
      if (moves[p] || !n.to_object.moves.empty()) moves[n.prototype] = true;
    }
  const Spool::View view = scene_.spool().map();
  const std::span<const ShapeRow> rows = view.rows;
  std::vector<bool> lifted(rows.size());
  double bytes = 0;
  bool opaque = false;
  for (std::size_t p = 0; p < prototypes.size(); ++p)
    for (const std::uint32_t r : prototypes[p].rows) {
      if (!is_interface(rows[r]) || uses[p] == 0) continue;
      if (moves[p]) {
        opaque = true;
      } else {
        lifted[r] = true;
        bytes += rows[r].bytes() * uses[p];
      }
    }
  if (bytes > kEmissiveBytes)
    opaque = true;
  else if (bytes > 0)
    lifted_ = std::move(lifted);
  if (opaque)
    warnings_.add({}, "surfaces without material that move, or are in too many instances, stop shadow rays");
  if (!lifted_.empty())
    for (const InstanceRecord& i : instances) lift(view, i.prototype, i.to_world, i.first_shape);
}

void SceneSplitter::Work::lift(const Spool::View& view, std::uint32_t prototype, const Transform& to_world,
                               std::uint32_t first_shape) {
  const PrototypeSpool& p = scene_.prototypes()[prototype];
  for (const std::uint32_t r : p.rows) {
    if (!is_lifted(r)) continue;
    const ShapeRow source = view.rows[r];
    ShapeRow row;
    row.shape = first_shape + source.shape;
    scene_.spool().add_moved(view, source, to_world, row);
  }
  for (const PrototypeSpool::Nested& n : p.nested)
    if (n.to_object.moves.empty())
      lift(view, n.prototype, to_world * n.to_object.fixed, first_shape + n.first_shape);
}

void SceneSplitter::Work::write_prototypes() {
  const std::vector<PrototypeSpool>& prototypes = scene_.prototypes();
  std::vector<std::uint32_t> uses(prototypes.size(), 0);
  std::vector<std::uint32_t> moving(prototypes.size(), 0);
  const std::span<const InstanceRecord> instances = scene_.instances().map();
  for (const InstanceRecord& i : instances) ++uses[i.prototype];
  for (const MotionRecord& m : scene_.motions().map()) ++moving[instances[m.instance].prototype];
  const std::vector<std::uint32_t> world_uses = uses;
  // An object refers only to objects before it, and to shapes of its own that move.
  for (std::size_t p = prototypes.size(); p-- > 0;)
    if (uses[p] > 0)
      for (const PrototypeSpool::Nested& n : prototypes[p].nested) uses[n.prototype] += uses[p];

  pieces_.resize(prototypes.size());
  std::vector<std::uint32_t> order(prototypes.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::stable_partition(order, [&](std::uint32_t p) { return prototypes[p].is_shape; });
  for (const std::uint32_t p : order) {
    if (uses[p] == 0) continue;
    const bool large = prototypes[p].bytes > static_cast<double>(options_.large_object);
    if (large && uses[p] == 1 && world_uses[p] == 1 && moving[p] == 0)
      move_into_world(p);
    else
      write_prototype(p);
    for (const PrototypeSpool::Nested& n : prototypes[p].nested)
      for (const Piece& piece : pieces_[n.prototype])
        pieces_[p].push_back(
            {piece.blob, n.first_shape + piece.first_shape, n.to_object * piece.to_object});
  }
}

void SceneSplitter::Work::write_prototype(std::uint32_t index) {
  const PrototypeSpool& prototype = scene_.prototypes()[index];
  PartMaker make = maker();
  SpoolArray<Item> file(scratch_);
  for (const std::uint32_t row : prototype.rows)
    if (!is_lifted(row)) make.items_of(row, [&](const Item& i) { file.push_back(i); });
  const std::span<Item> items = file.map();
  const bool split = prototype.bytes > kLargePrototype * static_cast<double>(options_.part_size);
  const double room = split ? capacity() : std::numeric_limits<double>::max();

  const auto write = [&](std::span<Item> run) {
    PartBuilder builder;
    make.add(run, builder);
    if (split && builder.predicted_bytes() > options_.part_size && run.size() > 1) return false;
    PrototypeInfo info;
    info.name = prototype.name;
    for (const Item& i : run) info.bounds.extend(i.box);
    info.loaded_bytes = builder.predicted_bytes();
    info.triangles = builder.triangle_count();
    info.shapes = prototype.shape_count;
    prototype_features_.push_back(builder.features());
    const auto blob = static_cast<std::uint32_t>(manifest_.prototypes.size());
    const PartBuilder::File written = builder.write(prototype_path(out_, blob));
    info.file_bytes = written.bytes;
    info.checksum = written.checksum;
    checksums_.push_back(written.checksum);
    manifest_.total_triangles += info.triangles;
    manifest_.prototypes.push_back(std::move(info));
    pieces_[index].push_back({blob, 0, Transform()});
    return true;
  };
  partition(
      items, [&](const Item& i) { return make.cost(i); }, room, write);
}

// The only instance of a very large object: its shapes become shapes of the world.
void SceneSplitter::Work::move_into_world(std::uint32_t index) {
  const PrototypeSpool& prototype = scene_.prototypes()[index];
  const auto instances = scene_.instances().map();
  const auto only = std::find_if(instances.begin(), instances.end(),
                                 [index](const InstanceRecord& i) { return i.prototype == index; });
  const Spool::View view = scene_.spool().map();
  for (const std::uint32_t r : prototype.rows) {
    if (is_lifted(r)) continue;
    const ShapeRow source = view.rows[r];
    ShapeRow row;
    row.shape = only->first_shape + source.shape;
    scene_.spool().add_moved(view, source, only->to_world, row);
  }
}

void SceneSplitter::Work::expand_instances() {
  std::uint64_t count = 0;
  const std::span<const InstanceRecord> instances = scene_.instances().map();
  const std::span<const MotionRecord> motions = scene_.motions().map();
  for (std::uint32_t n = 0; n < instances.size(); ++n) {
    const InstanceRecord& i = instances[n];
    Placing to_world(i.to_world);
    if (!motions.empty()) {
      const std::span<const MotionRecord> own = motions_of(motions, n);
      to_world.moves.assign(own.begin(), own.end());
    }
    for (const Piece& piece : pieces_[i.prototype]) {
      const Placing placing = to_world * piece.to_object;
      const InstanceRecord record{placing.fixed, piece.blob, i.first_shape + piece.first_shape};
      if (count >= kNone) throw SceneError({}, "more than 2^32 instances");
      const Item item{world_box(placing, manifest_.prototypes[piece.blob].bounds), kInstanceItem,
                      static_cast<std::uint32_t>(count)};
      if (!is_finite(item.box.min) || !is_finite(item.box.max)) continue;
      for (MotionRecord m : placing.moves) {
        m.instance = static_cast<std::uint32_t>(count);
        motions_.push_back(m);
      }
      ++count;
      records_.push_back(record);
      items_.push_back(item);
      instance_box_.extend(item.box);
    }
  }
  manifest_.moves = motions_.size() != 0;
}

void SceneSplitter::Work::add_bricks() {
  const std::span<SpooledBrick> bricks = scene_.grids().bricks();
  manifest_.bounded_media = clip_bricks(manifest_.scene, scene_.spool().map().rows, lifted_, bricks, warnings_);
  std::uint32_t number = 0;
  for (const SpooledBrick& b : bricks) {
    const std::uint32_t brick = number++;
    if (b.box.empty()) continue;
    items_.push_back({b.box, kBrickItem, brick});
    instance_box_.extend(b.box);
  }
  if (number && options_.text) warnings_.add({}, "density grids are not written as text");
}

// Rows of the shapes that every host holds. Marks them in in_main_.
std::vector<std::uint32_t> SceneSplitter::Work::choose_main_scene() {
  const std::span<const ShapeRow> rows = scene_.spool().map().rows;
  in_main_.assign(rows.size(), false);
  double emissive = 0, cheap = 0, interfaces = 0;
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (rows[r].prototype == kNone && rows[r].light != kNone) {
      in_main_[r] = true;
      emissive += rows[r].bytes();
    }
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (rows[r].prototype == kNone && is_interface(rows[r])) {
      in_main_[r] = true;
      interfaces += rows[r].bytes();
    }
  if (interfaces > kEmissiveBytes)
    warnings_.add({}, "surfaces between participating media take " +
                          std::to_string(static_cast<std::uint64_t>(interfaces) >> 20) + " MiB on every host");
  if (emissive > kEmissiveBytes)
    warnings_.add({}, "shapes that emit light take " +
                          std::to_string(static_cast<std::uint64_t>(emissive) >> 20) +
                          " MiB on every host");
  manifest_.bounds = scene_.bounds().empty() ? instance_box_ : scene_.bounds();
  Bounds3 scene = instance_box_;
  for (const ShapeRow& row : rows)
    if (row.prototype == kNone) scene.extend(row.box);

  // One part holds the rest: large shapes are in nobody's way there, and every ray saves a look at the main scene.
  const PartMaker make = maker();
  double rest_bytes = 0;
  for (const Item& i : items_.map()) rest_bytes += make.cost(i);
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (rows[r].prototype == kNone && !in_main_[r]) rest_bytes += rows[r].bytes();
  const bool one_part = rest_bytes <= capacity();

  for (bool again = !one_part; again;) {
    Bounds3 rest = instance_box_;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      if (rows[r].prototype != kNone || in_main_[r]) continue;
      const bool large = rows[r].box.surface_area() > kLargeShare * scene.surface_area();
      if (large && rows[r].bytes() <= kCheapBytes && cheap + rows[r].bytes() <= kAllCheapBytes) {
        in_main_[r] = true;
        cheap += rows[r].bytes();
      } else {
        rest.extend(rows[r].box);
      }
    }
    again = !rest.empty() && rest.surface_area() < kShrinks * scene.surface_area();
    scene = rest;
  }
  std::vector<std::uint32_t> chosen;
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (in_main_[r]) chosen.push_back(static_cast<std::uint32_t>(r));
  return chosen;
}

void SceneSplitter::Work::write_main_scene(const std::vector<std::uint32_t>& rows) {
  PartMaker make = maker();
  SpoolArray<Item> items(scratch_);
  for (const std::uint32_t row : rows)
    make.items_of(row, [&](const Item& i) { items.push_back(i); });
  write_part(items.map(), make, true);
}

void SceneSplitter::Work::write_world() {
  PartMaker make = maker();
  const std::span<const ShapeRow> rows = scene_.spool().map().rows;
  for (std::uint32_t r = 0; r < rows.size(); ++r)
    if (rows[r].prototype == kNone && !in_main_[r])
      make.items_of(r, [&](const Item& i) { items_.push_back(i); });
  partition(
      items_.map(), [&](const Item& i) { return make.cost(i); }, capacity(),
      [&](std::span<Item> run) { return write_part(run, make, run.size() == 1); });
}

bool SceneSplitter::Work::write_part(std::span<Item> items, PartMaker& make, bool accept_any) {
  PartBuilder builder;
  make.add(items, builder);
  PartInfo info;
  info.loaded_bytes = builder.predicted_bytes();
  if (info.loaded_bytes > options_.part_size && !accept_any) return false;
  info.triangles = builder.triangle_count();
  std::set<std::uint32_t> prototypes;
  const std::span<const InstanceRecord> records = records_.map();
  for (const Item& i : items)
    if (i.source == kInstanceItem) prototypes.insert(records[i.primitive].prototype);
  info.prototypes.assign(prototypes.begin(), prototypes.end());
  info.features = builder.features();
  for (const std::uint32_t p : prototypes) info.features |= prototype_features_[p];
  info.boxes = tight_boxes(items);
  const PartBuilder::File file =
      builder.write(part_path(out_, static_cast<std::uint32_t>(manifest_.parts.size())));
  info.file_bytes = file.bytes;
  info.checksum = file.checksum;
  checksums_.push_back(file.checksum);
  manifest_.total_triangles += info.triangles;
  manifest_.parts.push_back(std::move(info));
  return true;
}

SceneSplitter::SceneSplitter(const std::string& out_folder, const SplitOptions& options,
                             Warnings& warnings) {
  if (options.part_size == 0) throw UsageError("the part size must be larger than 0");
  prepare_folder(out_folder, options.text);
  work_ = std::make_unique<Work>(out_folder, options, warnings);
}

SceneSplitter::~SceneSplitter() = default;
SceneSink& SceneSplitter::sink() { return work_->sink(); }
Manifest SceneSplitter::finish(SceneDescription scene) { return work_->finish(std::move(scene)); }

}  // namespace cloudrenderer
