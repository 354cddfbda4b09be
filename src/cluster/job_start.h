#pragma once
// What the manager tells all hosts of a job, and what a host makes of it.
#include <string>

#include "integrator/job.h"
#include "integrator/scene_needs.h"
#include "parts/part.h"
#include "tasks/manager_core.h"

namespace cloudrenderer {

// What the build of a part, or of a prototype that it needs, takes beside what they take
// afterwards: an upper bound.
std::uint64_t build_bytes(const Manifest& manifest, std::uint32_t part);

// What of a segment's columns the job needs (wire/README.md).
wire::ColumnSet columns_of(const Manifest& manifest, const SceneNeeds& needs, bool light_paths = false);

// `folder`: of the split; told to the hosts when they share the file system with the manager.
JobSpec make_job_spec(const Manifest& manifest, const JobSettings& settings,
                      const JobOverrides& overrides, const SceneNeeds& needs,
                      const std::string& folder, bool shared_folder);

// The same settings again, on a host: made from its own manifest and the orders. Throws SceneError,
// or ClusterError when they do not fit together.
JobSettings settings_of(const wire::JobStart& start, const Manifest& manifest, Warnings& warnings);

}  // namespace cloudrenderer
