#pragma once
#include <compare>
#include <cstdint>
#include <functional>

namespace cloudrenderer {

// A number that cannot be mistaken for another kind of number. The default value is "none".
template <class Tag>
struct Id {
  static constexpr std::uint32_t kNone = 0xffffffffu;
  std::uint32_t value = kNone;

  constexpr Id() = default;
  constexpr explicit Id(std::uint32_t v) : value(v) {}
  constexpr explicit operator bool() const { return value != kNone; }
  friend constexpr auto operator<=>(Id, Id) = default;
};

using PartId = Id<struct PartTag>;      // 0 is the main scene's geometry, on every host
using HostId = Id<struct HostTag>;      // given by the manager, never used twice in a job; 0 is the manager
using MaterialId = Id<struct MaterialTag>;
using TextureId = Id<struct TextureTag>;
using AreaLightId = Id<struct AreaLightTag>;  // an AreaLightSource directive of the scene description
using MediumId = Id<struct MediumTag>;        // a participating medium of the scene description; none: vacuum
using ObjectId = Id<struct ObjectTag>;        // an ObjectBegin/ObjectEnd block: a prototype

}  // namespace cloudrenderer

template <class Tag>
struct std::hash<cloudrenderer::Id<Tag>> {
  std::size_t operator()(cloudrenderer::Id<Tag> id) const noexcept {
    return std::hash<std::uint32_t>{}(id.value);
  }
};
