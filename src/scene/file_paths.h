#pragma once
#include <set>
#include <string>
#include <string_view>

#include "base/error.h"

namespace cloudrenderer {

// Where the files that a scene names are. Names are relative to the folder of the top-level scene
// file; one that is not there is looked for beside the file that names it.
class FilePaths {
 public:
  // `confine`: the only folder that files may be in, links resolved; "": any. `named` collects what find() gives.
  explicit FilePaths(const std::string& scene_path, const std::string& confine = {}, std::set<std::string>* named = nullptr);

  // The absolute name of a file that `naming_file` names. A file that is nowhere gets its name in
  // the top folder, so that the message of who opens it is the expected one. "" stays "". Throws SceneError at `where`
  // when the file is, or would be, outside of the folder that files may be in, whether it is there or not.
  std::string find(const std::string& name, const std::string& naming_file, const FileLocation& where = {}) const;
  // The same for a file whose name is known already.
  void check(const std::string& path, const FileLocation& where) const;

 private:
  bool admits(const std::string& path) const;

  std::string top_, confine_;
  std::set<std::string>* named_;
};

// The one absolute name of a file, links resolved.
std::string canonical_file(const std::string& path);

// True for the parameters that name files to be read ("filename", "mapname", ...), which the parser
// makes absolute. The shapes of an "aperture" that pbrt-v4 has built in are none.
bool is_file_parameter(std::string_view name, std::string_view value);

}  // namespace cloudrenderer
