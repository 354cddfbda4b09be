#pragma once
#include "integrator/job.h"
#include "shading/material.h"

namespace cloudrenderer {

// What paths must carry and hosts must do beyond opaque, still surfaces of constant materials under light that rays
// cannot find. The rest is neither stored, nor sent, nor run.
struct SceneNeeds {
  Shading::Needs shading;
  bool infinite_light = false;  // from all sides: rays that escape find it
  bool media = false;           // between surfaces
  bool inside_media = false;    // and a path knows the one that it is in (v3)
  bool lens = false;            // rays start on a lens
  bool moving_camera = false;
};

// Checks materials, lights, media, camera and filter, without reading images: throws SceneError for what makes no picture, and
// warns of what is not supported.
SceneNeeds scene_needs(const SceneDescription& scene, const JobSettings& job, Warnings& warnings);

}  // namespace cloudrenderer
