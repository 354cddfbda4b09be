#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/bulk_array.h"
#include "base/error.h"
#include "scene/source_text.h"

namespace cloudrenderer {

struct Token {
  enum class Kind : std::uint8_t { end, word, string, number, open, close };
  Kind kind = Kind::end;
  std::string_view text;  // a string's without its quotes, escapes not yet resolved
  std::uint32_t line = 1, column = 1;
};

// Cuts a pbrt file into tokens. Knows nothing of directives, so that the parser, the dialect
// detection and tools can share it. Commas count as blanks. Throws SceneError for text that is no
// token.
class Lexer {
 public:
  explicit Lexer(std::shared_ptr<const SourceText> source);

  const Token& peek() {
    if (!has_peeked_) peeked_ = scan(), has_peeked_ = true;
    return peeked_;
  }
  Token next() {
    if (has_peeked_) return has_peeked_ = false, peeked_;
    return scan();
  }
  // The character that what follows the token last seen begins with; 0 at the end.
  char ahead() {
    skip_blanks();
    return p_ == end_ ? '\0' : *p_;
  }
  FileLocation location(const Token& t) const { return {source_->name(), t.line, t.column}; }
  FileLocation here() const { return location(at(p_)); }
  const SourceText& source() const { return *source_; }

  // The rest of an array of numbers, just after its '[', up to and including the ']'. `finite`:
  // numbers too large for a float are an error, else they are infinite, and "nan" and "inf" are read.
  BulkArray<float> read_floats(bool finite);
  // Whole numbers; fractions are cut off as in pbrt and counted in `fractions`.
  BulkArray<std::int32_t> read_integers(std::uint64_t& fractions);
  // Skips the rest of an array of anything.
  void skip_array();

  // What a token is called in an error message.
  static std::string describe(const Token& t);
  // The value of a string token: escapes as in C.
  static std::string unescape(std::string_view text);
  double to_double(const Token& t) const;  // of a number token
  float to_float(const Token& t) const;
  std::int32_t to_integer(const Token& t, std::uint64_t& fractions) const;

 private:
  Token scan();
  void skip_blanks();  // also commas and comments
  Token at(const char* p) const;
  [[noreturn]] void bad_number(const char* begin) const;
  std::int32_t read_integer(std::uint64_t& fractions);

  std::shared_ptr<const SourceText> source_;
  const char* p_;
  const char* end_;
  const char* line_start_;
  std::uint32_t line_ = 1;
  Token peeked_;
  bool has_peeked_ = false;
};

// Takes the next word between blanks from the front of the text, a parameter's type or name; "": there is none.
std::string_view take_word(std::string_view& text);

}  // namespace cloudrenderer
