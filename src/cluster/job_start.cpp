#include "cluster/job_start.h"

#include <charconv>
#include <filesystem>
#include <random>

#include "film/camera.h"
#include "film/features.h"
#include "parts/features.h"
#include "parts/part_builder.h"
#include "parts/part_map.h"

namespace cloudrenderer {
namespace {

constexpr const char* kMaxDepth = "max_depth";
constexpr const char* kFootprintSpp = "footprint_spp";
constexpr const char* kSamplesPerRay = "samples_per_ray";
constexpr std::uint32_t kLargestFilm = 1u << 16;

PlacementPart placement_part(const Manifest& manifest, std::uint32_t part) {
  const PartInfo& info = manifest.parts[part];
  PlacementPart p;
  p.bytes = info.loaded_bytes;
  p.prototypes = info.prototypes;
  p.build = build_bytes(manifest, part);
  p.page = loaded_bytes::page(info.triangles, info.loaded_bytes, p.build);
  Bounds3 bounds;
  for (const Bounds3& b : info.boxes) bounds.extend(b);
  if (!bounds.empty()) p.center = bounds.center();
  return p;
}

// An option of the job that is a number.
std::optional<std::uint32_t> number_option(const wire::JobStart& start, const char* name) {
  const auto found = start.options().find(name);
  if (found == start.options().end()) return std::nullopt;
  const std::string& text = found->second;
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size())
    throw ClusterError("the job's " + std::string(name) + " is '" + text + "'");
  return value;
}

// How often rays will be in each part, as far as the camera tells: a grid of its rays through the parts' boxes, of
// which each stops half of what enters; and a little everywhere, for what is scattered.
void expect_visits(const Manifest& manifest, const FilmFrame& frame, std::vector<PlacementPart>& parts) {
  constexpr std::uint32_t kGrid = 64;
  constexpr double kScattered = 0.25;
  if (parts.size() < 3) return;
  Warnings unheard;  // the tracer's camera says them
  const auto camera = Camera::build(manifest.scene.camera, frame, manifest.scene.dialect, unheard,
                                    film_diagonal(manifest.scene.film));
  const Shutter shutter = shutter_of(manifest.scene.camera);
  const PartMap map(manifest.parts);
  std::vector<Candidate> candidates(map.part_count());
  for (std::uint32_t y = 0; y < kGrid; ++y) {
    for (std::uint32_t x = 0; x < kGrid; ++x) {
      const Vec2 at((static_cast<float>(x) + 0.5f) / kGrid, (static_cast<float>(y) + 0.5f) / kGrid);
      const Vec2 film(static_cast<float>(frame.x0) + at.x * static_cast<float>(frame.crop_width()),
                      static_cast<float>(frame.y0) + at.y * static_cast<float>(frame.crop_height()));
      CameraRay ray = camera->ray(film, Vec2(0.5f));
      if (ray.weight == 0.f) continue;
      if (camera->moves()) camera->place(0.5f * shutter.open + 0.5f * shutter.close, ray);
      const std::size_t n = map.candidates(ray.origin, ray.direction, kInfinity, candidates);
      double left = 1;
      for (std::size_t i = 0; i < std::min(n, candidates.size()); ++i, left *= 0.5) parts[candidates[i].part].visits += left;
    }
  }
  double sum = 0;
  for (const PlacementPart& p : parts) sum += p.visits;
  const double scattered = kScattered * (sum > 0 ? sum : 1) / static_cast<double>(parts.size());
  for (PlacementPart& p : parts) p.visits += scattered;
}

}  // namespace

std::uint64_t build_bytes(const Manifest& manifest, std::uint32_t part) {
  const PartInfo& info = manifest.parts[part];
  std::uint64_t bytes = loaded_bytes::build(info.triangles, info.loaded_bytes);
  for (const std::uint32_t t : info.prototypes) {
    const PrototypeInfo& p = manifest.prototypes.at(t);
    bytes = std::max(bytes, loaded_bytes::build(p.triangles, p.loaded_bytes));
  }
  return bytes;
}

wire::ColumnSet columns_of(const Manifest& manifest, const SceneNeeds& needs, bool light_paths) {
  wire::ColumnSet columns = 0;
  if (manifest.parts.size() > 2) columns |= wire::kColumnBestHit | wire::kColumnTested;
  // Where a ray started counts when it finds a light; walks inside of surfaces keep their medium there.
  if (needs.infinite_light || !manifest.shape_lights.empty() || needs.shading.subsurface)
    columns |= wire::kColumnPreviousNormal;
  if (needs.shading.footprint || needs.media || light_paths) columns |= wire::kColumnCone;
  if (needs.inside_media) columns |= wire::kColumnMedium;
  return columns;
}

JobSpec make_job_spec(const Manifest& manifest, const JobSettings& settings,
                      const JobOverrides& overrides, const SceneNeeds& needs,
                      const std::string& folder, bool shared_folder) {
  JobSpec spec;
  spec.frame = settings.film.frame;
  spec.k = settings.k;
  spec.lobes = settings.lobes;
  spec.spp = settings.spp;
  spec.samples_per_ray = settings.samples_per_ray;
  spec.share_if_worth = settings.share_if_worth;
  spec.seed = settings.seed;
  for (std::uint32_t p = 0; p < manifest.parts.size(); ++p)
    spec.parts.push_back(placement_part(manifest, p));
  expect_visits(manifest, settings.film.frame, spec.parts);
  for (const PrototypeInfo& p : manifest.prototypes) spec.prototype_bytes.push_back(p.loaded_bytes);
  for (const PartInfo& p : manifest.parts) spec.part_features.push_back(feature_names(p.features));

  wire::JobStart& s = spec.start;
  s.set_job(std::random_device{}());
  s.set_scene(manifest.scene.source);
  s.set_manifest_bytes(std::filesystem::file_size(std::filesystem::path(folder) / "manifest.bin"));
  s.set_content_hash(manifest.content_hash);
  s.set_part_count(static_cast<std::uint32_t>(manifest.parts.size()));
  s.set_width(spec.frame.width);
  s.set_height(spec.frame.height);
  s.set_x0(spec.frame.x0);
  s.set_y0(spec.frame.y0);
  s.set_x1(spec.frame.x1);
  s.set_y1(spec.frame.y1);
  s.set_spp(settings.spp);
  s.set_seed(settings.seed);
  s.set_k(settings.k);
  s.set_features(settings.features);
  s.set_light_paths(static_cast<std::uint32_t>(settings.light_paths));
  s.set_columns(columns_of(manifest, needs, settings.light_paths != LightPaths::none));
  if (overrides.integrator) s.set_integrator(*overrides.integrator);
  // Zero is a depth too, so it is an option and not the field in which zero means "from the scene".
  if (overrides.max_depth) (*s.mutable_options())[kMaxDepth] = std::to_string(*overrides.max_depth);
  if (settings.footprint_spp != 0 && settings.footprint_spp != settings.spp)
    (*s.mutable_options())[kFootprintSpp] = std::to_string(settings.footprint_spp);
  // Not what the scene would say, which depends on the samples of this run.
  (*s.mutable_options())[kSamplesPerRay] = std::to_string(settings.samples_per_ray);
  if (shared_folder) s.set_parts_url(std::filesystem::absolute(folder).string());
  return spec;
}

JobSettings settings_of(const wire::JobStart& start, const Manifest& manifest, Warnings& warnings) {
  JobOverrides o;
  o.spp = start.spp();
  o.seed = static_cast<std::uint32_t>(start.seed());
  if (!start.integrator().empty()) o.integrator = start.integrator();
  o.max_depth = number_option(start, kMaxDepth);
  JobSettings settings = job_settings(manifest.scene, o, warnings);
  settings.k = start.k();
  settings.features = start.features();
  settings.light_paths = static_cast<LightPaths>(start.light_paths());
  settings.length_k = feature_length_k(manifest.bounds);
  settings.footprint_spp = number_option(start, kFootprintSpp).value_or(0);
  settings.samples_per_ray = number_option(start, kSamplesPerRay).value_or(1);
  if (!may_be_samples_per_ray(settings.samples_per_ray)) throw ClusterError("the job's samples per camera ray make no sense");
  settings.film.frame = {start.width(), start.height(), start.x0(),
                         start.y0(),    start.x1(),     start.y1()};
  const FilmFrame& f = settings.film.frame;
  if (f.width == 0 || f.height == 0 || f.width > kLargestFilm || f.height > kLargestFilm ||
      f.x0 >= f.x1 || f.y0 >= f.y1 || f.x1 > f.width || f.y1 > f.height || settings.k < 0 ||
      settings.k > 60 || settings.spp == 0)
    throw ClusterError("the job's film or sample count makes no sense");
  if (start.part_count() != manifest.parts.size() || start.content_hash() != manifest.content_hash)
    throw ClusterError("the job's split is not the one that this host has");
  return settings;
}

}  // namespace cloudrenderer
