#pragma once
#include <map>
#include <string>
#include <vector>

#include "base/log.h"
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

  // `reads_files` is false for directives whose "filename" is written to (Film).
  ParamSet read(Lexer& lexer, bool reads_files = true);

 private:
  Param read_one(Lexer& lexer, bool reads_files);
  BulkArray<float> reals(Lexer& lexer, bool finite);
  BulkArray<std::int32_t> integers(Lexer& lexer, const Param& p);
  BulkArray<std::int32_t> booleans(Lexer& lexer);
  std::vector<std::string> strings(Lexer& lexer);
  BulkArray<float> spectrum(Lexer& lexer, const Param& p);
  BulkArray<float> whole(BulkArray<float> values, std::size_t components, const Param& p);

  Dialect dialect_;
  const FilePaths& paths_;
  Warnings& warnings_;
  std::map<std::string, Rgb> spd_files_;  // already read
};

}  // namespace cloudrenderer
