#ifdef __SSE3__
#include <pmmintrin.h>
#include <xmmintrin.h>
#endif

#include <cstdint>
#include <string>

#include "base/error.h"
#include "trace/embree.h"
#include "trace/resident.h"

namespace cloudrenderer {

Device::Device(unsigned threads, const char* isa)
    : device_(rtcNewDevice(("threads=" + std::to_string(threads) + ",max_isa=" + isa + ",set_affinity=0").c_str())) {
  if (!device_) throw ClusterError("Embree cannot make a device");
  rtcSetDeviceMemoryMonitorFunction(
      device_,
      [](void* self, ssize_t bytes, bool) {
        static_cast<Device*>(self)->add(bytes);
        return true;
      },
      this);
}

Device::~Device() { rtcReleaseDevice(device_); }

void Device::add(std::int64_t bytes) {
  const std::uint64_t now = bytes_.fetch_add(static_cast<std::uint64_t>(bytes)) + static_cast<std::uint64_t>(bytes);
  std::uint64_t seen = peak_.load();
  while (now > seen && now < (std::uint64_t{1} << 62) && !peak_.compare_exchange_weak(seen, now)) {
  }
}

void Device::add_shared(std::int64_t bytes) { add(bytes); }

void Device::attach(RTCScene scene, unsigned number, std::size_t count, const void* data, const Functions& functions) const {
  const GeometryHandle g(rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_USER));
  rtcSetGeometryUserPrimitiveCount(g.get(), static_cast<unsigned>(count));
  rtcSetGeometryUserData(g.get(), const_cast<void*>(data));  // given back to the functions, which read it
  rtcSetGeometryBoundsFunction(g.get(), functions.bounds, nullptr);
  rtcSetGeometryIntersectFunction(g.get(), functions.intersect);
  rtcSetGeometryOccludedFunction(g.get(), functions.occluded);
  rtcCommitGeometry(g.get());
  rtcAttachGeometryByID(scene, g.get(), number);
}

void Device::check(const char* what) const {
  const RTCError e = rtcGetDeviceError(device_);
  if (e == RTC_ERROR_NONE) return;
  throw ClusterError(std::string("Embree: ") + what + ": " +
                     (e == RTC_ERROR_OUT_OF_MEMORY ? "out of memory" : "error " + std::to_string(static_cast<int>(e))));
}

void prepare_compute_thread() {
#if defined(__SSE3__)
  _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
  _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
#elif defined(__aarch64__)
  std::uint64_t control;
  asm volatile("mrs %0, fpcr" : "=r"(control));
  asm volatile("msr fpcr, %0" : : "r"(control | std::uint64_t{1} << 24));  // FZ: operands and results
#else
#error "how do threads of this processor flush denormal numbers to zero?"
#endif
}

}  // namespace cloudrenderer
