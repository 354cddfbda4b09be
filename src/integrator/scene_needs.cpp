#include "integrator/scene_needs.h"

#include "film/camera.h"
#include "shading/lights.h"
#include "shading/media.h"

namespace cloudrenderer {

SceneNeeds scene_needs(const SceneDescription& scene, const JobSettings& job, Warnings& warnings) {
  SceneNeeds needs;
  needs.shading = Shading::check(scene, warnings);
  needs.infinite_light = Lights::check(scene, warnings);
  Media::check(scene, warnings);
  needs.media = job.media != MediaTransport::none && !scene.media.empty();
  needs.inside_media = needs.media && job.media == MediaTransport::multiple;
  const auto camera = Camera::build(scene.camera, job.film.frame, scene.dialect, warnings, film_diagonal(scene.film));
  Filter::build(scene.filter, warnings, scene.dialect);
  needs.lens = camera->uses_lens();
  needs.moving_camera = camera->moves();
  return needs;
}

}  // namespace cloudrenderer
