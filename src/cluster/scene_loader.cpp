#include "cluster/scene_loader.h"

#include <filesystem>
#include <fstream>
#include <set>

#include "base/log.h"
#include "cluster/job_start.h"
#include "images/images.h"
#include "parts/check.h"
#include "parts/part_builder.h"
#include "parts/split.h"

namespace cloudrenderer {

struct SceneLoader::Scene {
  ~Scene() {
    if (cache) cache->add_other(-static_cast<std::int64_t>(counted));
  }
  std::shared_ptr<PartCache> cache;  // of all jobs of the process; null: this is the only one
  std::uint64_t counted = 0;         // there, beside the parts
  std::shared_ptr<const Manifest> manifest;
  std::string folder;
  std::unique_ptr<TemporaryFolder>
      fetched;  // holds what came over the wire; else the folder is somebody's
  std::unique_ptr<Resident> resident;
  std::unique_ptr<PathTracer> tracer;         // works on `resident`
  std::vector<std::uint32_t> prototype_uses;  // by loaded parts
};

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFiles = "files/";
constexpr std::uint64_t kLargestFile = std::uint64_t{1} << 40;

// The names of all files/... that a scene refers to.
std::set<std::string> referenced_files(const SceneDescription& scene) {
  std::set<std::string> names;
  const auto look = [&](const Entity& e) {
    for (const Param& p : e.params.all())
      if (p.type == ParamType::string)
        for (const std::string& s : p.strings)
          if (s.starts_with(kFiles)) names.insert(s.substr(kFiles.size()));
  };
  look(scene.camera);
  look(scene.sampler);
  look(scene.integrator);
  for (const auto& e : scene.textures) look(e);
  for (const auto& e : scene.materials) look(e);
  for (const auto& e : scene.lights) look(e);
  for (const auto& e : scene.area_lights) look(e);
  return names;
}

void must(const std::string& error, const std::string& what) {
  if (!error.empty()) throw ClusterError("cannot fetch " + what + ": " + error);
}

// Manifest and files of the scene, into an empty folder; parts follow when they are asked for.
void fetch_scene(BlobFetcher& fetcher, const wire::JobStart& job, const std::string& folder) {
  const std::string path = folder + "/manifest.bin";
  must(fetcher.fetch({wire::BLOB_MANIFEST, 0, {}}, path, job.manifest_bytes()), "the manifest");
  std::vector<std::byte> bytes(fs::file_size(path));
  std::ifstream in(path, std::ios::binary);
  in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const Result<Manifest> manifest = decode_manifest(bytes);
  if (!manifest) throw ClusterError("the manifest that the manager sent: " + manifest.error());
  for (const std::string& name : referenced_files(manifest->scene)) {
    if (fs::path(name).filename() != name)
      throw ClusterError("the manifest names a file outside of its folder");
    must(fetcher.fetch({wire::BLOB_FILE, 0, name}, folder + "/files/" + name, kLargestFile), name);
  }
}

// Of a part that another scene has loaded: the file is the same, what its numbers mean need not be.
void check_references(const Part& part, const Manifest& manifest, const char* what,
                      std::uint32_t number) {
  if (const auto bad = find_bad_reference(part, manifest))
    throw ClusterError(std::string(what) + " " + std::to_string(number) + ": " + *bad);
}

template <class F>
std::string error_of(F f) {
  try {
    f();
    return {};
  } catch (const std::exception& e) {
    const std::string what = e.what();
    return what.empty() ? "unknown error" : what;
  }
}

}  // namespace

SceneLoader::SceneLoader(unsigned build_threads, std::uint64_t memory, SceneSources sources)
    : build_threads_(build_threads), memory_(memory), sources_(std::move(sources)) {
  limit_images(cache() ? cache()->budget() : memory_);
}
SceneLoader::~SceneLoader() {
  if (PartCache* const shared = cache()) shared->release(this);
}

std::unique_ptr<SceneLoader::Scene> SceneLoader::open(const wire::JobStart& job) {
  auto scene = std::make_unique<Scene>();
  if (sources_.manifest) {
    scene->manifest = sources_.manifest;
    scene->folder = job.parts_url();
    return scene;
  }
  for (const std::string& folder : {sources_.folder, job.parts_url()}) {
    if (folder.empty() || !is_split_folder(folder)) continue;
    auto manifest = std::make_shared<Manifest>(open_split(folder));
    if (manifest->content_hash != job.content_hash()) continue;
    scene->manifest = std::move(manifest);
    scene->folder = folder;
    return scene;
  }
  if (!sources_.fetcher) throw ClusterError("the split is not at " + job.parts_url());
  scene->fetched = std::make_unique<TemporaryFolder>();
  scene->folder = scene->fetched->path();
  fetch_scene(*sources_.fetcher, job, scene->folder);
  scene->manifest = std::make_shared<Manifest>(open_split(scene->folder));
  return scene;
}

std::string SceneLoader::start_job(const wire::JobStart& job) {
  return error_of([&] {
    end_job();
    std::shared_ptr<Scene> scene = open(job);
    Warnings warnings;  // the manager has told the user already, but for what only the pixels of maps tell
    const JobSettings settings = settings_of(job, *scene->manifest, warnings);
    Resident::Options options;
    options.threads = build_threads_;
    if (sources_.seat) options.cache = scene->cache = sources_.seat->host().cache;
    if (!reserve(*scene, 0, BvhForm::fast))
      throw ClusterError("the other jobs of this host leave no room for the main scene");
    scene->resident = std::make_unique<Resident>(options);
    scene->prototype_uses.assign(scene->manifest->prototypes.size(), 0);
    load_prototypes(*scene, 0);
    scene->tracer = std::make_unique<PathTracer>(
        *scene->manifest, settings, read(*scene, wire::BLOB_PART, 0), *scene->resident, warnings);
    for (const std::string& w : warnings.list())
      if (w.find(" texels ") != std::string::npos) spdlog::warn("{}", w);
    if (const std::string_view why = scene->tracer->no_light_paths(); !why.empty()) spdlog::warn("there are no paths from lights: {}", why);
    const std::uint64_t used = scene->resident->bytes() + scene->tracer->shading_bytes();
    if (used > memory_)
      throw ClusterError("main scene, textures and lights take " + std::to_string(used >> 20) +
                         " MiB, and the host may use " + std::to_string(memory_ >> 20) + " MiB");
    if (PartCache* const shared = cache()) {
      scene->counted = scene->tracer->shading_bytes();
      shared->add_other(static_cast<std::int64_t>(scene->counted));
      shared->release(this);
      shared->tidy();
      if (shared->bytes() > shared->budget())
        throw ClusterError("the other jobs of this host leave no room for textures and lights");
    }
    const std::lock_guard lock(mutex_);
    scene_ = std::move(scene);
  });
}

Part SceneLoader::read(Scene& scene, wire::BlobKind kind, std::uint32_t index) {
  const bool part = kind == wire::BLOB_PART;
  const std::string what = (part ? "part " : "prototype ") + std::to_string(index);
  const std::string path =
      part ? part_path(scene.folder, index) : prototype_path(scene.folder, index);
  const Manifest& m = *scene.manifest;
  if (index >= (part ? m.parts.size() : m.prototypes.size()))
    throw ClusterError("there is no " + what);
  if (scene.fetched && !fs::exists(path))
    must(sources_.fetcher->fetch({kind, index, {}}, path,
                                 part ? m.parts[index].file_bytes : m.prototypes[index].file_bytes),
         what);
  Result<Part> read = read_part_file(path);
  if (!read) throw ClusterError(what + ": " + read.error());
  const std::uint64_t checksum = part ? m.parts[index].checksum : m.prototypes[index].checksum;
  if (checksum != 0 && read->checksum != checksum)
    throw ClusterError(what + ": the file is not the one that the manifest means");
  if (const auto bad = find_bad_reference(*read, m)) throw ClusterError(what + ": " + *bad);
  return std::move(*read);
}

void SceneLoader::load_prototypes(Scene& scene, std::uint32_t part) {
  for (const std::uint32_t p : scene.manifest->parts[part].prototypes) {
    if (p >= scene.prototype_uses.size())
      throw ClusterError("there is no prototype " + std::to_string(p));
    if (scene.prototype_uses[p]++ != 0) continue;
    const auto read_it = [&] { return read(scene, wire::BLOB_PROTOTYPE, p); };
    if (!cache()) {
      scene.resident->load_prototype(p, read_it());
      continue;
    }
    const bool shared = scene.resident->share_prototype(
        p, prototype_key(*scene.manifest, p), read_it,
        [&](const Part& there) { check_references(there, *scene.manifest, "prototype", p); });
    count(shared, scene.manifest->prototypes[p].loaded_bytes);
  }
}

void SceneLoader::count(bool shared, std::uint64_t bytes) {
  Meter::Account& account = sources_.seat->account();
  (shared ? account.shared_bytes : account.loaded_bytes) += bytes;
}

// What loading a part takes that is not there already.
std::vector<PartCache::Need> SceneLoader::needs(const Scene& scene, std::uint32_t part,
                                                BvhForm form) const {
  const Manifest& m = *scene.manifest;
  const PartInfo& info = m.parts[part];
  const std::uint64_t build = build_bytes(m, part);
  // The main scene is never shared.
  std::vector<PartCache::Need> all{{part == 0 ? PartKey{} : part_key(m, part, form),
                                    form == BvhForm::passing
                                        ? loaded_bytes::page(info.triangles, info.loaded_bytes, build)
                                        : info.loaded_bytes + build}};
  for (const std::uint32_t p : info.prototypes)
    if (scene.prototype_uses[p] == 0) all.push_back({prototype_key(m, p), m.prototypes[p].loaded_bytes});
  return all;
}

bool SceneLoader::reserve(const Scene& scene, std::uint32_t part, BvhForm form) const {
  return !cache() || cache()->reserve(this, needs(scene, part, form));
}

// By what is really resident now, so that a prediction that was too low (or textures, which nobody
// predicts) makes the host take fewer parts, and not more memory.
bool SceneLoader::has_room(PartId part, BvhForm form) const {
  const std::shared_ptr<Scene> s = scene();
  if (!s || part.value >= s->manifest->parts.size()) return true;  // load() says what is wrong
  std::uint64_t more = 0;
  for (const PartCache::Need& need : needs(*s, part.value, form)) more += need.bytes;
  return bytes_used() + more <= memory_ && reserve(*s, part.value, form);
}

std::string SceneLoader::load(PartId part, BvhForm form) {
  return error_of([&] {
    const std::shared_ptr<Scene> s = scene();
    if (!s) throw ClusterError("no job has been started");
    const auto read_it = [&] { return read(*s, wire::BLOB_PART, part.value); };
    if (!cache()) {
      Part data = read_it();
      load_prototypes(*s, part.value);
      s->resident->load_part(part, std::move(data), form);
      return;
    }
    if (part.value >= s->manifest->parts.size())
      throw ClusterError("there is no part " + std::to_string(part.value));
    load_prototypes(*s, part.value);
    const bool shared = s->resident->share_part(
        part, part_key(*s->manifest, part.value, form), form, read_it,
        [&](const Part& there) { check_references(there, *s->manifest, "part", part.value); });
    cache()->release(this);
    count(shared, s->manifest->parts[part.value].loaded_bytes);
  });
}

void SceneLoader::unload(PartId part) {
  const std::shared_ptr<Scene> s = scene();
  if (!s || part.value >= s->manifest->parts.size()) return;
  s->resident->unload_part(part);
  for (const std::uint32_t p : s->manifest->parts[part.value].prototypes)
    if (--s->prototype_uses[p] == 0) s->resident->unload_prototype(p);
}

void SceneLoader::end_job() {
  const std::lock_guard lock(mutex_);
  scene_.reset();
}

std::shared_ptr<SceneLoader::Scene> SceneLoader::scene() const {
  const std::lock_guard lock(mutex_);
  return scene_;
}

std::uint64_t SceneLoader::bytes_used() const {
  const auto s = scene();
  return s ? s->resident->bytes() + s->tracer->shading_bytes() : 0;
}

std::shared_ptr<const PathEngine> SceneLoader::engine() const {
  const auto s = scene();
  return s ? std::shared_ptr<const PathEngine>(s, s->tracer.get()) : nullptr;
}

std::uint64_t SceneLoader::peak_bytes() const {
  const auto s = scene();
  return s ? s->resident->peak_bytes() + s->tracer->shading_bytes() : 0;
}

double SceneLoader::own_bytes() const {
  const auto s = scene();
  return s ? s->resident->own_bytes() + static_cast<double>(s->tracer->shading_bytes()) : 0;
}

std::array<double, 4> SceneLoader::engine_seconds() const {
  const auto s = scene();
  if (!s) return {};
  const EngineTime& t = s->tracer->time();
  const auto seconds = [](const std::atomic<std::uint64_t>& ns) {
    return static_cast<double>(ns.load()) * 1e-9;
  };
  return {seconds(t.camera), seconds(t.trace), seconds(t.shade), seconds(t.occlusion)};
}

}  // namespace cloudrenderer
