#pragma once
// Inside src/trace only: owners of Embree's handles.
#include <embree3/rtcore.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>

namespace cloudrenderer {

struct SceneReleaser {
  void operator()(RTCScene s) const { rtcReleaseScene(s); }
};
struct GeometryReleaser {
  void operator()(RTCGeometry g) const { rtcReleaseGeometry(g); }
};
using SceneHandle = std::unique_ptr<std::remove_pointer_t<RTCScene>, SceneReleaser>;
using GeometryHandle = std::unique_ptr<std::remove_pointer_t<RTCGeometry>, GeometryReleaser>;

class Device {
 public:
  Device(unsigned threads, const char* isa);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  RTCDevice get() const { return device_; }
  // Throws ClusterError if Embree has reported an error since the last call.
  void check(const char* what) const;
  // Attaches `count` primitives of our own to a scene as its geometry `number`; `data` is what the functions get, and outlives it.
  struct Functions {
    RTCBoundsFunction bounds;
    RTCIntersectFunctionN intersect;
    RTCOccludedFunctionN occluded;
  };
  void attach(RTCScene scene, unsigned number, std::size_t count, const void* data, const Functions& functions) const;
  std::uint64_t bytes() const { return bytes_.load(std::memory_order_relaxed); }

  // Bytes of arrays that Embree shares with us; counted together with its own.
  void add_shared(std::int64_t bytes);
  std::uint64_t peak() const { return peak_.load(std::memory_order_relaxed); }

 private:
  void add(std::int64_t bytes);
  RTCDevice device_;
  std::atomic<std::uint64_t> bytes_{0};
  std::atomic<std::uint64_t> peak_{0};
};

}  // namespace cloudrenderer
