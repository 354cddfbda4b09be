#include "scene/ply_header.h"

#include <array>
#include <charconv>
#include <optional>

namespace cloudrenderer {

namespace {

struct TypeName {
  std::string_view name;
  PlyType type;
};
constexpr auto kTypeNames = std::to_array<TypeName>({{"char", PlyType::int8},
                                                     {"int8", PlyType::int8},
                                                     {"uchar", PlyType::uint8},
                                                     {"uint8", PlyType::uint8},
                                                     {"short", PlyType::int16},
                                                     {"int16", PlyType::int16},
                                                     {"ushort", PlyType::uint16},
                                                     {"uint16", PlyType::uint16},
                                                     {"int", PlyType::int32},
                                                     {"int32", PlyType::int32},
                                                     {"uint", PlyType::uint32},
                                                     {"uint32", PlyType::uint32},
                                                     {"float", PlyType::float32},
                                                     {"float32", PlyType::float32},
                                                     {"double", PlyType::float64},
                                                     {"float64", PlyType::float64}});

// No file has more; bounds the work that a header can ask for.
constexpr std::size_t kMostElements = 100, kMostProperties = 1000;

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  while (true) {
    const std::size_t first = line.find_first_not_of(" \t\r");
    if (first == std::string_view::npos) return words;
    line.remove_prefix(first);
    const std::size_t n = std::min(line.find_first_of(" \t\r"), line.size());
    words.push_back(line.substr(0, n));
    line.remove_prefix(n);
  }
}

class HeaderReader {
 public:
  explicit HeaderReader(const SourceText& text) : text_(text) {}

  PlyHeader read() {
    if (words_of(next_line()) != std::vector<std::string_view>{"ply"})
      fail("a PLY file must begin with \"ply\"");
    bool has_format = false;
    while (true) {
      const auto words = words_of(next_line());
      if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      if (words[0] == "format")
        read_format(words), has_format = true;
      else if (words[0] == "element")
        read_element(words);
      else if (words[0] == "property")
        read_property(words);
      else
        fail("unknown line \"" + std::string(words[0].substr(0, 40)) + "\" in the PLY header");
    }
    if (!has_format) fail("the PLY header does not give a format");
    header_.bytes = position_;
    header_.lines = line_;
    return std::move(header_);
  }

 private:
  [[noreturn]] void fail(const std::string& why) const {
    throw SceneError({text_.name(), line_, 1}, why);
  }

  std::string_view next_line() {
    const std::string_view rest = text_.view().substr(position_);
    const std::size_t end = rest.find('\n');
    ++line_;
    if (end == std::string_view::npos) fail("the PLY header does not end");
    position_ += end + 1;
    return rest.substr(0, end);
  }

  PlyType type(std::string_view word) const {
    for (const TypeName& t : kTypeNames)
      if (t.name == word) return t.type;
    fail("unknown type \"" + std::string(word.substr(0, 40)) + "\" in the PLY header");
  }

  void read_format(const std::vector<std::string_view>& words) {
    if (words.size() == 3 && words[2] == "1.0") {
      if (words[1] == "ascii") return void(header_.format = PlyFormat::ascii);
      if (words[1] == "binary_little_endian")
        return void(header_.format = PlyFormat::little_endian);
      if (words[1] == "binary_big_endian") return void(header_.format = PlyFormat::big_endian);
    }
    fail("the PLY format must be ascii, binary_little_endian or binary_big_endian, and 1.0");
  }

  void read_element(const std::vector<std::string_view>& words) {
    PlyElement e;
    if (words.size() != 3) fail("expected \"element name count\"");
    const auto [stop, error] =
        std::from_chars(words[2].data(), words[2].data() + words[2].size(), e.count);
    if (error != std::errc{} || stop != words[2].data() + words[2].size())
      fail("\"" + std::string(words[2].substr(0, 40)) + "\" is no count of elements");
    if (header_.elements.size() == kMostElements) fail("too many elements in the PLY header");
    e.name = std::string(words[1]);
    header_.elements.push_back(std::move(e));
  }

  void read_property(const std::vector<std::string_view>& words) {
    if (header_.elements.empty()) fail("a property before the first element");
    auto& properties = header_.elements.back().properties;
    if (properties.size() == kMostProperties) fail("too many properties in the PLY header");
    PlyProperty p;
    if (words.size() == 5 && words[1] == "list") {
      p.is_list = true;
      p.count_type = type(words[2]);
      p.type = type(words[3]);
      if (p.count_type == PlyType::float32 || p.count_type == PlyType::float64)
        fail("the length of a list must be a whole number");
    } else if (words.size() == 3) {
      p.type = type(words[1]);
    } else {
      fail("expected \"property type name\" or \"property list type type name\"");
    }
    p.name = std::string(words.back());
    properties.push_back(std::move(p));
  }

  const SourceText& text_;
  PlyHeader header_;
  std::size_t position_ = 0;
  std::uint32_t line_ = 0;
};

}  // namespace

PlyHeader read_ply_header(const SourceText& text) { return HeaderReader(text).read(); }

}  // namespace cloudrenderer
