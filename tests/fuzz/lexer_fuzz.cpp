// Every token, and every way to read an array.
#include "fuzz/fuzz.h"
#include "scene/lexer.h"

using namespace cloudrenderer;

namespace {

void read_all(Lexer& lexer) {
  std::uint64_t fractions = 0;
  unsigned arrays = 0;
  for (Token t = lexer.next(); t.kind != Token::Kind::end; t = lexer.next()) {
    (void)Lexer::describe(t);
    if (t.kind == Token::Kind::string) (void)Lexer::unescape(t.text);
    if (t.kind == Token::Kind::number) {
      (void)lexer.to_double(t);
      (void)lexer.to_float(t);
      (void)lexer.to_integer(t, fractions);
    }
    if (t.kind != Token::Kind::open) continue;
    switch (arrays++ % 4) {
      case 0:
        (void)lexer.read_floats(true);
        break;
      case 1:
        (void)lexer.read_integers(fractions);
        break;
      case 2:
        (void)lexer.read_floats(false);
        break;
      default:
        lexer.skip_array();
    }
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Lexer lexer(SourceText::from_string("scene.pbrt", {reinterpret_cast<const char*>(data), size}));
  try {
    read_all(lexer);
  } catch (const SceneError& e) {
    fuzz::require(std::string(e.what()).starts_with("scene.pbrt:"), "an error says where");
  }
  return 0;
}
