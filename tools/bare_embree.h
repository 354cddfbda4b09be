#pragma once
// Embree with nothing around it: the ceiling that bench_ceiling.cpp compares the program with.
#include <embree3/rtcore.h>

#include <memory>
#include <span>
#include <vector>

#include "integrator/path_segment.h"
#include "parts/part.h"

namespace cloudrenderer {

// Triangles of parts, and instances of triangles, in one Embree scene without filters. What is not a triangle, and what
// moves, is left out and counted.
class BareEmbree {
 public:
  BareEmbree(bool robust, const char* isa);
  ~BareEmbree();
  BareEmbree(const BareEmbree&) = delete;
  BareEmbree& operator=(const BareEmbree&) = delete;

  void add_prototype(const Part& part);  // in the order of their numbers, before the parts
  void add_part(const Part& part);       // lives as long as this
  void commit();                         // on this thread alone

  std::size_t left_out() const { return left_out_; }
  std::size_t bytes() const { return bytes_; }  // by Embree's monitor: BVHs, and buffers that are not shared

  // Each ray by itself, or in packets of eight; `alike`: neighbours start and go alike. How many hit something.
  std::uint64_t intersect(std::span<const OcclusionRay> rays, bool packets, bool alike) const;
  std::uint64_t occluded(std::span<const OcclusionRay> rays, bool packets) const;

 private:
  void add_triangles(RTCScene to, const Part& part);

  RTCDevice device_;
  RTCScene scene_;
  bool robust_;
  std::vector<RTCScene> prototypes_;
  std::size_t left_out_ = 0, bytes_ = 0;
};

}  // namespace cloudrenderer
