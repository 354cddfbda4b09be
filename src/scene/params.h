#pragma once
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/bulk_array.h"
#include "base/error.h"
#include "base/log.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

enum class ParamType : std::uint8_t {
  boolean,
  integer,
  real,
  point2,
  vector2,
  point3,
  vector3,
  normal3,
  rgb,
  string,
  texture
};
const char* type_word(ParamType type);  // as pbrt-v3 spells it: "point", "rgb"

// One parameter. Spectra of every spelling (rgb, xyz, blackbody, sampled, .spd) have become rgb
// when it was read.
struct Param {
  ParamType type = ParamType::real;
  std::string name;
  BulkArray<float> reals;            // real, point*, vector*, normal3, rgb: flat components
  BulkArray<std::int32_t> integers;  // integer, boolean (0 or 1)
  std::vector<std::string> strings;  // string, texture (the unique name, see TextureDesc)
  FileLocation location;
  mutable bool used = false;
};

// The typed parameters of one directive. Every look-up marks the parameter as used, so that a
// parameter that nobody asked for can be reported. Look-ups with a default return the default when
// the name is absent; a parameter of another type or a wrong number of values throws SceneError at
// its location.
class ParamSet {
 public:
  void add(Param p);  // a later parameter of the same name replaces the earlier one
  // Takes a parameter out; for translations between dialects.
  std::optional<Param> take(std::string_view name);
  void rename(std::string_view from, std::string_view to);  // if it is there
  bool empty() const { return params_.empty(); }
  const std::vector<Param>& all() const { return params_; }
  const Param* find(std::string_view name) const;  // of any type, or null; does not mark it
  bool has(std::string_view name) const { return find(name) != nullptr; }

  bool boolean(std::string_view name, bool otherwise) const;
  int integer(std::string_view name, int otherwise) const;
  float real(std::string_view name, float otherwise) const;    // an integer is accepted too
  Rgb rgb(std::string_view name, const Rgb& otherwise) const;  // a real is accepted too, as grey
  Vec3 point3(std::string_view name, const Vec3& otherwise) const;
  Vec3 vector3(std::string_view name, const Vec3& otherwise) const;
  std::string string(std::string_view name, std::string_view otherwise) const;
  std::optional<std::string> texture(
      std::string_view name) const;  // unique texture name if given as a texture

  BulkArray<float> reals(
      std::string_view name) const;  // any real-valued type, flat; empty when absent
  BulkArray<std::int32_t> integers(std::string_view name) const;  // empty when absent

  // Warns about each parameter that no look-up has marked, unless the language's tables say that it
  // is to be ignored. `owner` is e.g. `Shape "sphere"`; `once` holds what has been said before.
  void report_unused(std::string_view owner, Warnings& warnings,
                     std::set<std::string>* once = nullptr) const;

 private:
  std::vector<Param> params_;
};

}  // namespace cloudrenderer
