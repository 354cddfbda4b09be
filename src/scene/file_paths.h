#pragma once
#include <string>
#include <string_view>

namespace cloudrenderer {

// Where the files that a scene names are. Names are relative to the folder of the top-level scene
// file; one that is not there is looked for beside the file that names it.
class FilePaths {
 public:
  explicit FilePaths(const std::string& scene_path);

  // The absolute name of a file that `naming_file` names. A file that is nowhere gets its name in
  // the top folder, so that the message of who opens it is the expected one. "" stays "".
  std::string find(const std::string& name, const std::string& naming_file) const;

 private:
  std::string top_;
};

// The one absolute name of a file, links resolved.
std::string canonical_file(const std::string& path);

// True for the parameters that name files to be read ("filename", "mapname", ...), which the parser
// makes absolute.
bool is_file_parameter(std::string_view name);

}  // namespace cloudrenderer
