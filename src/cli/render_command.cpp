#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "cli/commands.h"
#include "cli/progress.h"
#include "cli/report.h"
#include "cli/size.h"
#include "cluster/processes.h"
#include "net/handshake.h"
#include "web/display.h"
#include "web/window.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

std::string output_path(const RenderOptions& o, const FilmOptions& film) {
  if (o.output.empty())
    return fs::path(film.filename.empty() ? "image.exr" : film.filename).filename().string();
  if (!is_image_name(o.output)) throw UsageError("'" + o.output + "' must end in " + image_extensions());
  return o.output;
}

// Found out before hours of rendering, not behind them.
void check_writable(const std::string& path, const char* what) {
  const fs::path folder = fs::absolute(path).parent_path();
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    throw UsageError(std::string(what) + ": there is no folder " + folder.string());
  const std::string probe = path + ".cloudrenderer";
  if (!std::ofstream(probe)) throw UsageError(std::string("cannot write ") + what + " " + path);
  fs::remove(probe, ignored);
}

constexpr auto kFeatureLayers = std::to_array<std::pair<const char*, FeatureLayer>>(
    {{"albedo", FeatureLayer::albedo}, {"normal", FeatureLayer::normal}, {"depth", FeatureLayer::depth},
     {"position", FeatureLayer::position}, {"ids", FeatureLayer::ids}});

// Three channels of linear sRGB to the picture's colours.
void convert(std::vector<ImageChannel>& rgb, const ColorSpace& space) {
  const glm::mat3 to_space = space.from_working();
  auto& r = std::get<std::vector<float>>(rgb[0].values);
  auto& g = std::get<std::vector<float>>(rgb[1].values);
  auto& b = std::get<std::vector<float>>(rgb[2].values);
  for (std::size_t i = 0; i < r.size(); ++i) {
    const Rgb c = to_space * Rgb(r[i], g[i], b[i]);
    r[i] = c.x;
    g[i] = c.y;
    b[i] = c.z;
  }
}

// What --layers asks for.
std::vector<ImageChannel> channels(const RenderOptions& o, const RenderOutcome& r) {
  std::vector<ImageChannel> out;
  if (o.layers.contains("error")) out = error_layer(*r.film, r.facts.settings.film.scale);
  if (o.layers.contains("samples")) out.push_back(samples_layer(*r.film));
  for (const auto& [name, layer] : kFeatureLayers)
    if (o.layers.contains(name)) {
      auto made = feature_channels(r.features, layer, r.facts.settings.length_k);
      if (const auto& space = r.facts.settings.film.space; space && layer == FeatureLayer::albedo) convert(made, *space);
      std::ranges::move(made, std::back_inserter(out));
    }
  return out;
}

std::map<std::string, std::string> metadata(const RenderOptions& o, const RenderOutcome& r) {
  const JobSettings& s = r.facts.settings;
  static constexpr std::array<const char*, 3> kIntegrators{"path", "directlighting",
                                                           "ambientocclusion"};
  std::string line;
  for (const std::string& word : o.command_line) line += (line.empty() ? "" : " ") + word;
  return {{"Software", "cloudrenderer " CLOUDRENDERER_VERSION},
          {"cloudrenderer:scene", o.request.scene},
          {"cloudrenderer:spp", std::to_string(s.spp)},
          {"cloudrenderer:spp_done", std::to_string(r.spp_done)},
          {"cloudrenderer:footprint_spp",
           std::to_string(s.footprint_spp ? s.footprint_spp : s.spp)},
          {"cloudrenderer:seed", std::to_string(s.seed)},
          {"cloudrenderer:k", std::to_string(s.k)},
          {"cloudrenderer:integrator", kIntegrators[static_cast<std::size_t>(s.integrator)]},
          {"cloudrenderer:light_vertices", std::to_string(s.light_vertices)},
          {"cloudrenderer:emission_vertex", std::to_string(s.emission_vertex)},
          {"cloudrenderer:film_scale", fmt::format("{}", s.film.scale)},
          {"cloudrenderer:sequence",
           s.sequence == SampleSequence::Kind::sobol ? "sobol" : "independent"},
          {"cloudrenderer:command", line}};
}

void print_summary(const RenderOutcome& r, const std::string& output) {
  fmt::print(
      "{}: {} x {} pixels, {:.4g} samples each, {:.1f} s to load, {:.1f} s to render, {:.2f} M "
      "samples/s\n",
      output, r.facts.settings.film.frame.crop_width(), r.facts.settings.film.frame.crop_height(),
      r.spp_mean, r.load_s, r.render_s,
      r.render_s > 0 ? static_cast<double>(r.paths_done - r.paths_restored) / r.render_s * 1e-6 : 0.0);
}

// What is left when the picture could not be written.
std::string after_lost_picture(const RenderOutcome& r) {
  if (!r.checkpoint_error.empty()) return "; " + r.checkpoint_error;
  if (r.checkpoint.empty()) return "";
  return "; --checkpoint " + r.checkpoint + " --resume writes it without rendering anew what is there";
}

}  // namespace

int run_render(const RenderOptions& given, Interrupts& interrupts) {
  if (given.parent > 0) die_with_parent(given.parent);
  RenderOptions o = given;
  RenderRequest& request = o.request;
  if (!fs::exists(request.scene)) throw SceneError({}, request.scene + ": there is no such file");
  request.features = std::ranges::any_of(kFeatureLayers, [&](const auto& l) { return o.layers.contains(l.first); });
  if (request.listen) request.token = read_token(o.token_file);
  if (request.listen && !request.listen->is_loopback() && request.token.empty() &&
      request.tls.authority.empty())
    spdlog::warn(
        "anybody who reaches {} can join: a token (--token-file, CLOUDRENDERER_TOKEN) keeps "
        "strangers out",
        request.listen->to_string());
  if (!o.reference.empty()) {
    try {
      request.reference = read_image(o.reference);
    } catch (const std::exception& e) {
      throw UsageError("--reference: " + std::string(e.what()));
    }
  }
  if (!o.report.empty()) check_writable(o.report, "the report");

  ProgressDisplay progress(stderr, o.quiet);
  RenderObserver observer;
  std::string output;
  observer.scene_ready = [&](const SceneFacts& facts) {
    print_warnings(facts.warnings);
    output = output_path(o, facts.settings.film);
    if (!o.layers.empty() && fs::path(output).extension() != ".exr")
      throw UsageError("--layers needs a picture that ends in .exr, got '" + output + "'");
    check_writable(output, "the picture");
  };
  observer.default_checkpoint = [&] {
    return fs::path(output).replace_extension(".ckpt").string();
  };
  observer.listening = [&](const Address& address) {
    // Scripts that started us with port 0 wait for this line.
    fmt::print("listening on {}\n", address.to_string());
    std::fflush(stdout);
  };
  observer.progress = [&](const RenderProgress& p) { progress.show(p); };
  std::optional<Window> window;
  if (o.web) {
    const std::string token = request.listen ? request.token : read_token("");
    window.emplace(WindowOptions{*o.web, token, request.tls, fs::path(request.scene).filename().string()},
                   [&] { interrupts.raise(); });
    fmt::print("{} shows the render\n", window->url());
    std::fflush(stdout);
  }
  std::optional<Display> viewer;
  if (o.display) viewer.emplace(*o.display, fs::path(request.scene).filename().string());
  if (window || viewer)
    observer.look = [&](const RenderView& view) {
      if (window) window->look(view);
      if (viewer) viewer->look(view);
    };
  const RenderOutcome outcome = render(request, observer, interrupts);
  progress.finish();

  const Image image = developed(*outcome.film, outcome.facts.settings.film);
  try {
    write_image(output, image, outcome.film->frame(), {metadata(o, outcome), outcome.facts.camera_matrices}, channels(o, outcome));
  } catch (const std::runtime_error& e) {
    throw ClusterError(e.what() + after_lost_picture(outcome));
  }
  std::optional<ImageDifference> difference;
  // Pixels without a sample yet would be compared as black.
  if (request.reference && !outcome.interrupted)
    difference = compare_images(image, *request.reference);
  if (!o.report.empty()) {
    std::ofstream out(o.report);
    out << make_report(outcome, request.scene, difference).dump(1) << "\n";
    if (!out.flush()) throw std::runtime_error("cannot write the report " + o.report);
  }
  if (!o.quiet) print_summary(outcome, output);
  if (outcome.invalid_samples > 0)
    fmt::print(stderr, "warning: {} samples were not finite and were left out\n",
               outcome.invalid_samples);
  if (!outcome.checkpoint_error.empty())
    throw ClusterError(outcome.checkpoint_error + "; " + output + " holds what was there");
  if (outcome.interrupted) {
    fmt::print(stderr, "interrupted: {} holds what was there, and --checkpoint {} --resume goes on\n",
               output, outcome.checkpoint);
    return kInterrupted;
  }
  return outcome.bound_met ? kDone : kBoundNotMet;
}

}  // namespace cloudrenderer
