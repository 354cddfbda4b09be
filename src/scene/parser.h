#pragma once
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "scene/description.h"
#include "scene/file_paths.h"
#include "scene/graphics_state.h"
#include "scene/language.h"
#include "scene/lexer.h"
#include "scene/param_reader.h"
#include "scene/param_types.h"
#include "scene/scene_builder.h"
#include "scene/translate_v4.h"

namespace cloudrenderer {

// Reads the directives of a scene file and its includes in order, keeps the graphics state, and
// hands on what they describe: geometry to the sink, everything else to the SceneBuilder. One use.
class Parser {
 public:
  // `options.dialect` counts for nothing here.
  Parser(const std::string& path, Dialect dialect, SceneSink& sink, Warnings& warnings, const ParseOptions& options = {});
  // The words that are directives, for tests of the language's tables.
  static std::vector<std::string> directives();
  SceneDescription parse();

 private:
  using Handler = void (Parser::*)(const Token&);
  static const std::map<std::string_view, Handler>& handlers();

  // parser.cpp: files, state and blocks
  void open_file(const std::string& path, const FileLocation& named_at);
  void close_file();
  void include(const Token& t);
  void world_begin(const Token& t);
  bool skip_world(const Token& t);
  void world_end(const Token& t);
  void attribute_begin(const Token& t);
  void attribute_end(const Token& t);
  void transform_begin(const Token& t);
  void transform_end(const Token& t);
  void object_begin(const Token& t);
  void object_end(const Token& t);
  void object_instance(const Token& t);
  void warn_no_object(const FileLocation& where, const std::string& name);
  void place_early_instances();
  void close_object();

  // parser_directives.cpp: what has parameters
  void camera(const Token& t);
  void film(const Token& t);
  void sampler(const Token& t);
  void pixel_filter(const Token& t);
  void integrator(const Token& t);
  void renderer(const Token& t);
  void volume_integrator(const Token& t);
  void accelerator(const Token& t);
  void light_source(const Token& t);
  void area_light_source(const Token& t);
  void material(const Token& t);
  void make_named_material(const Token& t);
  void named_material(const Token& t);
  void texture(const Token& t);
  void shape(const Token& t);
  void make_named_medium(const Token& t);
  void medium_interface(const Token& t);
  void volume(const Token& t);
  void reverse_orientation(const Token& t);

  // parser_v4.cpp: what only pbrt-v4 has
  void attribute(const Token& t);
  void color_space(const Token& t);
  void import_file(const Token& t);
  void option(const Token& t);
  bool is_v4() const { return dialect_ == Dialect::v4; }
  // Adds what `Attribute` says, and drops with a warning what v4 does not have.
  void complete_v4(std::string_view directive, Entity& e);

  // parser_transforms.cpp
  void identity(const Token& t);
  void look_at_directive(const Token& t);
  void scale_directive(const Token& t);
  void rotate_directive(const Token& t);
  void translate_directive(const Token& t);
  void transform(const Token& t);
  void concat_transform(const Token& t);
  void coordinate_system(const Token& t);
  void coord_sys_transform(const Token& t);
  void active_transform(const Token& t);
  void transform_times(const Token& t);
  void apply(const Token& t, const DMat4& m, bool replaces);
  void apply(const Token& t, const DMat4& m, bool replaces, DMat4& to);
  // The movement of what is described now; none where it stands still, or (with a warning) where it cannot move.
  std::optional<Motion> motion(const FileLocation& where, const char* what);
  // What pbrt does not move stands where it starts.
  void stands_still(const FileLocation& where, const char* what);

  Lexer& lexer() { return files_.back().lexer; }
  FileLocation location(const Token& t) { return lexer().location(t); }
  std::string read_string(const char* what);
  double read_number(const Token& directive);
  DVec3 read_vector(const Token& directive);
  DMat4 read_matrix(const Token& directive);
  Entity read_entity(const Token& directive, bool reads_files = true);
  void count_use(std::string_view directive, const Entity& e);
  bool read_included_params(ParamSet& params, bool reads_files);
  Entity read_option(const Token& directive, bool reads_files);
  // Whether the directive is where pbrt wants it: inside or outside of the world; else warns, and
  // it is ignored.
  bool in_world(const Token& t);
  bool in_options(const Token& t);

  struct OpenFile {
    std::string path;  // without links, to see an endless include
    Lexer lexer;
    bool imported = false;  // the graphics state goes back at its end
  };
  // The current transformation matrix; a second one only where something moves.
  struct Ctm {
    DMat4 start{1.0};
    std::optional<DMat4> end;
    Ctm inverse() const;
  };
  enum class Active : std::uint8_t { all, start, end };  // which of the two directives change
  struct SavedTransform {
    Ctm ctm;
    Active active;
  };

  Dialect dialect_;
  FilePaths paths_;
  SceneSink& sink_;
  Warnings& warnings_;
  LanguageUse* use_;
  SceneBuilder builder_;
  ParamReader params_;
  ParamTypes types_;
  V4Translator v4_;
  std::map<const LanguageRow*, std::vector<LanguageParam>> v4_params_;
  std::vector<OpenFile> files_;

  // Deeper nesting than any scene has; bounds what a broken file can make us hold.
  static constexpr std::size_t kDeepestNesting = 20000;
  enum class Block { options, world, done };
  Block block_ = Block::options;
  Ctm ctm_;
  Active active_ = Active::all;
  GraphicsState state_;
  std::vector<GraphicsState> saved_states_;
  std::vector<SavedTransform> saved_transforms_;
  std::map<std::string, Ctm> coordinate_systems_;
  std::map<std::string, ObjectId> objects_;
  std::vector<std::pair<std::string, InstanceDesc>> early_instances_;  // of objects that were not there yet (pbrt-v4)
  std::uint32_t object_count_ = 0;
  ObjectId open_object_;
};

}  // namespace cloudrenderer
