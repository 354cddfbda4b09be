#include "scene/lexer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "scene/number.h"

namespace cloudrenderer {

namespace {

constexpr std::ptrdiff_t kLongestString = 1 << 16;

bool is_delimiter(char c) {
  switch (c) {
    case ' ':
    case '\t':
    case '\n':
    case '\r':
    case '\f':
    case '\v':
    case '[':
    case ']':
    case '"':
    case '#':
    case ',':
      return true;
    default:
      return false;
  }
}
bool starts_number(char c) { return detail::is_digit(c) || c == '-' || c == '+' || c == '.'; }

const char* find_delimiter(const char* p, const char* end) {
  while (p != end && !is_delimiter(*p)) ++p;
  return p;
}

std::string shortened(std::string_view text) {
  constexpr std::size_t kMost = 40;
  std::string out(text.substr(0, kMost));
  for (char& c : out)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  return text.size() > kMost ? out + "..." : out;
}

std::string quoted(char mark, std::string_view text) {
  std::string out(1, mark);
  out += shortened(text);
  return out += mark;
}

// Gathers values: few stay in a plain vector, many go through the writer (which spills to a file).
template <class T>
class Gather {
 public:
  void push_back(T v) {
    if (n_ == buffer_.size()) flush();
    buffer_[n_++] = v;
  }
  BulkArray<T> finish() {
    if (!flushed_) return BulkArray<T>(std::vector<T>(buffer_.data(), buffer_.data() + n_));
    flush();
    return writer_.finish();
  }

 private:
  void flush() {
    writer_.append(std::span<const T>(buffer_.data(), n_));
    n_ = 0;
    flushed_ = true;
  }
  std::array<T, 4096> buffer_;
  std::size_t n_ = 0;
  bool flushed_ = false;
  BulkWriter<T> writer_;
};

}  // namespace

Lexer::Lexer(std::shared_ptr<const SourceText> source) : source_(std::move(source)) {
  std::string_view text = source_->view();
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);  // UTF-8 byte order mark
  p_ = line_start_ = text.data();
  end_ = p_ + text.size();
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff"))
    throw SceneError(here(), "the file is text in UTF-16: UTF-8 is needed");
}

Token Lexer::at(const char* p) const {
  Token t;
  t.line = line_;
  t.column = static_cast<std::uint32_t>(std::min<std::ptrdiff_t>(p - line_start_ + 1, 0x7fffffff));
  return t;
}

void Lexer::skip_blanks() {
  while (p_ != end_) {
    switch (*p_) {
      case '\n':
        ++line_;
        line_start_ = ++p_;
        break;
      case ' ':
      case '\t':
      case '\r':
      case '\f':
      case '\v':
      case ',':
        ++p_;
        break;
      case '#': {
        const char* const comment = p_;
        const void* eol = std::memchr(p_, '\n', static_cast<std::size_t>(end_ - p_));
        p_ = eol ? static_cast<const char*>(eol) : end_;
        // Files of old Macs have nothing but this at the ends of lines.
        if (const void* cr = std::memchr(comment, '\r', static_cast<std::size_t>(p_ - comment))) p_ = static_cast<const char*>(cr);
        break;
      }
      default:
        return;
    }
  }
}

Token Lexer::scan() {
  skip_blanks();
  Token t = at(p_);
  if (p_ == end_) return t;
  const char* begin = p_;
  const char c = *p_;
  if (c == '[' || c == ']') {
    t.kind = c == '[' ? Token::Kind::open : Token::Kind::close;
    ++p_;
  } else if (c == '"') {
    t.kind = Token::Kind::string;
    begin = ++p_;
    while (p_ != end_ && *p_ != '"') {
      if (*p_ == '\n') throw SceneError(location(t), "the string does not end on its line");
      p_ += *p_ == '\\' && p_ + 1 != end_ && p_[1] != '\n' ? 2 : 1;
    }
    if (p_ == end_) throw SceneError(location(t), "the string does not end");
    if (p_ - begin > kLongestString) throw SceneError(location(t), "the string is too long");
    t.text = {begin, static_cast<std::size_t>(p_ - begin)};
    ++p_;
    return t;
  } else {
    p_ = find_delimiter(p_, end_);
    t.kind = starts_number(c) ? Token::Kind::number : Token::Kind::word;
  }
  t.text = {begin, static_cast<std::size_t>(p_ - begin)};
  return t;
}

void Lexer::bad_number(const char* begin) const {
  const Token t = at(begin);
  if (begin == end_)
    throw SceneError(location(t), "expected a number or ']', found the end of the file");
  if (starts_number(*begin)) {
    const std::string_view text(begin,
                                static_cast<std::size_t>(find_delimiter(begin, end_) - begin));
    throw SceneError(location(t), quoted('\'', text) + " is not a number");
  }
  const std::size_t n = static_cast<std::size_t>(find_delimiter(begin, end_) - begin);
  throw SceneError(location(t), "expected a number or ']', found " +
                                    quoted('\'', {begin, std::max<std::size_t>(n, 1)}));
}

BulkArray<float> Lexer::read_floats(bool finite) {
  Gather<float> out;
  while (true) {
    skip_blanks();
    if (p_ != end_ && *p_ == ']') break;
    const char* const begin = p_;
    float v;
    if (p_ == end_ || !starts_number(*p_) || !parse_float(p_, end_, v) ||
        (p_ != end_ && !is_delimiter(*p_))) {
      p_ = begin;
      if (finite || !parse_non_finite(p_, end_, v) || (p_ != end_ && !is_delimiter(*p_))) bad_number(begin);
    }
    if (finite && !std::isfinite(v))
      throw SceneError(location(at(begin)), "the number is too large for a float");
    out.push_back(v);
  }
  ++p_;
  return out.finish();
}

std::int32_t Lexer::read_integer(std::uint64_t& fractions) {
  const char* const begin = p_;
  if (p_ == end_ || !starts_number(*p_)) bad_number(begin);
  const bool negative = *p_ == '-';
  if (negative || *p_ == '+') ++p_;
  const char* const first = p_;
  std::int64_t v = 0;
  for (; p_ != end_ && detail::is_digit(*p_) && p_ - first < 12; ++p_) v = v * 10 + (*p_ - '0');
  if (negative) v = -v;
  if (p_ == first || (p_ != end_ && !is_delimiter(*p_))) {  // "4.0" or "1e3"
    p_ = find_delimiter(begin, end_);
    double d = 0;
    const char* from = begin + (*begin == '+');
    const auto [stop, error] = std::from_chars(from, p_, d);
    if (stop != p_ || error == std::errc::invalid_argument) bad_number(begin);
    if (error != std::errc{} || !(std::fabs(d) < 4e9)) d = 4e9;
    v = static_cast<std::int64_t>(d);
    fractions += static_cast<double>(v) != d;
  }
  if (v < std::numeric_limits<std::int32_t>::min() || v > std::numeric_limits<std::int32_t>::max())
    throw SceneError(location(at(begin)), "the number does not fit an integer of 32 bits");
  return static_cast<std::int32_t>(v);
}

BulkArray<std::int32_t> Lexer::read_integers(std::uint64_t& fractions) {
  Gather<std::int32_t> out;
  while (true) {
    skip_blanks();
    if (p_ != end_ && *p_ == ']') break;
    out.push_back(read_integer(fractions));
  }
  ++p_;
  return out.finish();
}

void Lexer::skip_array() {
  while (true) {
    while (p_ != end_ && *p_ != ']' && *p_ != '"' && *p_ != '#' && *p_ != '\n') ++p_;
    if (p_ == end_) return;
    switch (*p_) {
      case ']':
        ++p_;
        return;
      case '"':
        scan();
        break;
      default:
        skip_blanks();
    }
  }
}

std::string Lexer::describe(const Token& t) {
  switch (t.kind) {
    case Token::Kind::end:
      return "the end of the file";
    case Token::Kind::string:
      return quoted('"', t.text);
    default:
      return quoted('\'', t.text);
  }
}

std::string Lexer::unescape(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\\' || i + 1 == text.size()) {
      out += text[i];
      continue;
    }
    switch (text[++i]) {
      case 'n':
        out += '\n';
        break;
      case 't':
        out += '\t';
        break;
      case 'r':
        out += '\r';
        break;
      case '"':
        out += '"';
        break;
      case '\\':
        out += '\\';
        break;
      default:
        out += '\\', out += text[i];  // a path as Windows writes it
    }
  }
  return out;
}

double Lexer::to_double(const Token& t) const {
  const char* begin = t.text.data();
  const char* const end = begin + t.text.size();
  begin += begin != end && *begin == '+' && begin + 1 != end && begin[1] != '-';
  double v = 0;
  const auto [stop, error] = std::from_chars(begin, end, v);
  if (t.kind != Token::Kind::number || stop != end || error == std::errc::invalid_argument)
    throw SceneError(location(t), describe(t) + " is not a number");
  if (error == std::errc::result_out_of_range) v = static_cast<double>(to_float(t));
  return v;
}

float Lexer::to_float(const Token& t) const {
  const char* p = t.text.data();
  const char* const end = p + t.text.size();
  float v = 0;
  if (t.kind != Token::Kind::number || !parse_float(p, end, v) || p != end)
    throw SceneError(location(t), describe(t) + " is not a number");
  return v;
}

std::int32_t Lexer::to_integer(const Token& t, std::uint64_t& fractions) const {
  const double d = to_double(t);
  if (!(d >= -2147483648.0 && d <= 2147483647.0))
    throw SceneError(location(t), "the number does not fit an integer of 32 bits");
  const auto v = static_cast<std::int32_t>(d);
  fractions += static_cast<double>(v) != d;
  return v;
}

std::string_view take_word(std::string_view& text) {
  constexpr std::string_view kBlank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return text = {};
  text.remove_prefix(first);
  const std::string_view word = text.substr(0, text.find_first_of(kBlank));
  text.remove_prefix(word.size());
  return word;
}

}  // namespace cloudrenderer
