#pragma once
#include <map>
#include <span>
#include <string>
#include <vector>

#include "base/log.h"
#include "scene/color_space.h"
#include "scene/description.h"
#include "scene/file_paths.h"
#include "scene/lexer.h"
#include "scene/params.h"
#include "scene/spectrum.h"

namespace cloudrenderer {

// Reads the parameter list of a directive: `"type name" value ...` until something else follows.
// Spectra become RGB as the dialect has it, names of files to read become absolute.
class ParamReader {
 public:
  ParamReader(Dialect dialect, const FilePaths& paths, Warnings& warnings)
      : dialect_(dialect), paths_(paths), warnings_(warnings) {}

  // pbrt-v4: what the spectra that follow are of, and the colour space of RGB values.
  enum class SpectrumUse { reflectance, light };
  void set_use(SpectrumUse use) { use_ = use; }
  void set_color_space(const ColorSpace& space) { space_ = space; }

  // `reads_files` is false for directives whose "filename" is written to (Film).
  ParamSet read(Lexer& lexer, bool reads_files = true);
  // Adds to a list that another file began.
  void read_more(Lexer& lexer, ParamSet& params, bool reads_files);

 private:
  // None, with a warning: it has no type, or values that are not of it.
  std::optional<Param> read_one(Lexer& lexer, bool reads_files);
  void skip_value(Lexer& lexer);
  BulkArray<float> reals(Lexer& lexer, bool finite);
  BulkArray<std::int32_t> integers(Lexer& lexer, const Param& p);
  BulkArray<std::int32_t> booleans(Lexer& lexer, const Param& p);
  bool without_nan(Param& p);
  std::vector<std::string> strings(Lexer& lexer);
  Rgb from_samples(SampledSpectrum samples) const;
  Rgb from_blackbody(std::span<const float> v) const;
  Rgb spectrum_called(const std::string& name, Lexer& lexer, const Token& where);
  BulkArray<float> spectrum(Lexer& lexer, const Param& p);
  BulkArray<float> whole(BulkArray<float> values, std::size_t components, const Param& p);

  Dialect dialect_;
  const FilePaths& paths_;
  Warnings& warnings_;
  SpectrumUse use_ = SpectrumUse::reflectance;  // but of "Le", which is light always
  ColorSpace space_;
  std::map<std::pair<SpectrumUse, std::string>, Rgb> spd_files_;  // already read
};

}  // namespace cloudrenderer
