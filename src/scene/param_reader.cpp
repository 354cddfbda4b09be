#include "scene/param_reader.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <utility>
#include <span>

#include "scene/named_spectra.h"

namespace cloudrenderer {

namespace {

// More than any directive has; keeps a list of parameters from becoming a list of work.
constexpr std::size_t kMostParams = 1000;
constexpr std::size_t kMostSamples = 1000000;

enum class Spelling : std::uint8_t { plain, xyz, blackbody, spectrum };

struct TypeRow {
  std::string_view word;
  ParamType type;
  Spelling spelling = Spelling::plain;
  std::size_t components = 1;
};

constexpr std::array<TypeRow, 20> kTypes{{
    {"float", ParamType::real},
    {"integer", ParamType::integer},
    {"bool", ParamType::boolean},
    {"string", ParamType::string},
    {"texture", ParamType::texture},
    {"point", ParamType::point3, Spelling::plain, 3},
    {"point3", ParamType::point3, Spelling::plain, 3},
    {"point2", ParamType::point2, Spelling::plain, 2},
    {"vector", ParamType::vector3, Spelling::plain, 3},
    {"vector3", ParamType::vector3, Spelling::plain, 3},
    {"vector2", ParamType::vector2, Spelling::plain, 2},
    {"normal", ParamType::normal3, Spelling::plain, 3},
    {"normal3", ParamType::normal3, Spelling::plain, 3},
    {"rgb", ParamType::rgb, Spelling::plain, 3},
    {"color", ParamType::rgb, Spelling::plain, 3},
    {"xyz", ParamType::rgb, Spelling::xyz, 3},
    {"blackbody", ParamType::rgb, Spelling::blackbody, 2},
    {"spectrum", ParamType::rgb, Spelling::spectrum, 2},
    {"int", ParamType::integer},
    {"boolean", ParamType::boolean},
}};

const TypeRow* declared_type(std::string_view& rest) {
  const std::string_view word = take_word(rest);
  const auto* const found = std::ranges::find(kTypes, word, &TypeRow::word);
  return found == kTypes.end() ? nullptr : found;
}

std::string no_type(std::string_view declaration) {
  std::string known;
  for (const TypeRow& row : kTypes) known += (known.empty() ? "" : ", ") + std::string(row.word);
  return "expected a parameter as \"type name\", found \"" + std::string(declaration) + "\"; types are " + known;
}

BulkArray<float> from_colors(const std::vector<Rgb>& colors) {
  std::vector<float> flat;
  flat.reserve(colors.size() * 3);
  for (const Rgb& c : colors) flat.insert(flat.end(), {c.x, c.y, c.z});
  return BulkArray<float>(std::move(flat));
}

// Whether the value that follows can be of a type, as far as its first character says.
bool begins_value(Lexer& lexer, const TypeRow& type) {
  const Token& value = lexer.peek();
  if (value.kind == Token::Kind::end || value.kind == Token::Kind::word) return true;  // an error of its own
  const char first = value.kind == Token::Kind::open     ? lexer.ahead()
                     : value.kind == Token::Kind::string ? '"'
                                                         : value.text.front();
  const bool number = (first >= '0' && first <= '9') || first == '-' || first == '+' || first == '.';
  if (type.type == ParamType::string || type.type == ParamType::texture || type.type == ParamType::boolean) return !number;
  return first != '"' || type.spelling == Spelling::spectrum;
}

}  // namespace

ParamSet ParamReader::read(Lexer& lexer, bool reads_files) {
  ParamSet out;
  read_more(lexer, out, reads_files);
  return out;
}

void ParamReader::read_more(Lexer& lexer, ParamSet& out, bool reads_files) {
  while (lexer.peek().kind == Token::Kind::string) {
    if (out.all().size() == kMostParams)
      throw SceneError(lexer.location(lexer.peek()),
                       "more than " + std::to_string(kMostParams) + " parameters");
    std::optional<Param> p = read_one(lexer, reads_files);
    if (!p) continue;
    // Before pbrt-v4 a texture counts, whatever else has its name; in pbrt-v2 the value does where there is no such texture.
    const Param* const there = dialect_ == Dialect::v4 ? nullptr : out.find(p->name);
    if (there && dialect_ == Dialect::v2 && (there->type == ParamType::texture) != (p->type == ParamType::texture)) {
      Param texture = there->type == ParamType::texture ? *there : *p;
      const Param& value = there->type == ParamType::texture ? *p : *there;
      if (value.type == ParamType::rgb || value.type == ParamType::real) texture.reals = value.reals;
      out.add(std::move(texture));
    } else if (!there || there->type != ParamType::texture || p->type == ParamType::texture) {
      out.add(std::move(*p));
    }
  }
}

void ParamReader::skip_value(Lexer& lexer) {
  const Token& value = lexer.peek();
  if (value.kind == Token::Kind::open) {
    lexer.next();
    lexer.skip_array();
  } else if (value.kind == Token::Kind::string || value.kind == Token::Kind::number) {
    lexer.next();
  }
}

std::optional<Param> ParamReader::read_one(Lexer& lexer, bool reads_files) {
  const Token declaration = lexer.next();
  Param p;
  p.location = lexer.location(declaration);
  std::string_view rest = declaration.text;
  const TypeRow* const declared = declared_type(rest);
  if (!declared) {
    if (dialect_ == Dialect::v4) throw SceneError(p.location, no_type(declaration.text));
    warnings_.add(p.location, no_type(declaration.text) + ": ignored, as in pbrt");
    skip_value(lexer);
    return std::nullopt;
  }
  const TypeRow& row = *declared;
  p.type = row.type;
  p.name = std::string(take_word(rest));
  if (p.name.empty())
    throw SceneError(p.location, "the parameter \"" + std::string(row.word) + "\" has no name");
  if (dialect_ != Dialect::v4 && !begins_value(lexer, row)) {
    warnings_.add(p.location, "the value of parameter \"" + p.name + "\" is not of type " + std::string(row.word) +
                                  ": ignored, as in pbrt");
    skip_value(lexer);
    return std::nullopt;
  }

  const SpectrumUse use = std::exchange(use_, p.name == "Le" ? SpectrumUse::light : use_);
  if (row.type == ParamType::integer) {
    p.integers = integers(lexer, p);
  } else if (row.type == ParamType::boolean) {
    p.integers = booleans(lexer, p);
  } else if (row.type == ParamType::string || row.type == ParamType::texture) {
    p.strings = strings(lexer);
    for (std::string& s : p.strings)
      if (row.type == ParamType::string && reads_files && is_file_parameter(p.name, s))
        s = paths_.find(s, *lexer.source().name(), p.location);
  } else if (row.spelling == Spelling::spectrum) {
    p.reals = spectrum(lexer, p);
  } else {
    // v4's temperatures have no scale beside them.
    const bool v4_blackbody = dialect_ == Dialect::v4 && row.spelling == Spelling::blackbody;
    const std::size_t components = v4_blackbody ? 1 : row.components;
    p.reals = whole(reals(lexer, row.type != ParamType::real && row.type != ParamType::normal3), components, p);
    if (p.type == ParamType::real && !without_nan(p)) {
      use_ = use;
      return std::nullopt;
    }
    std::vector<Rgb> colors;
    const auto v = p.reals.view();
    if (row.spelling == Spelling::xyz)
      for (std::size_t i = 0; i < v.size(); i += 3)
        colors.push_back(xyz_to_rgb(static_cast<double>(v[i]), static_cast<double>(v[i + 1]),
                                    static_cast<double>(v[i + 2])));
    if (row.spelling == Spelling::blackbody)
      for (std::size_t i = 0; i < v.size(); i += components)
        colors.push_back(from_blackbody(v.subspan(i, components)));
    const bool converts =
        dialect_ == Dialect::v4 && p.type == ParamType::rgb && row.spelling == Spelling::plain;
    if (converts)
      for (std::size_t i = 0; i < v.size(); i += 3)
        colors.push_back(space_.to_working({v[i], v[i + 1], v[i + 2]}));
    if (converts || row.spelling != Spelling::plain) p.reals = from_colors(colors);
  }
  use_ = use;
  return p;
}

// Excess components are dropped with a warning, as in pbrt.
BulkArray<float> ParamReader::whole(BulkArray<float> values, std::size_t components,
                                    const Param& p) {
  const std::size_t excess = values.size() % components;
  if (excess == 0) return values;
  const std::size_t kept = values.size() - excess;
  const std::string numbers = "parameter \"" + p.name + "\" has " + std::to_string(values.size()) +
                              " numbers, which is no multiple of " + std::to_string(components);
  if (kept == 0) throw SceneError(p.location, numbers);
  warnings_.add(p.location, numbers + ": the last " + std::to_string(excess) + " ignored");
  auto held = std::make_shared<const BulkArray<float>>(std::move(values));
  const std::span<const float> view = held->view().first(kept);
  return {std::move(held), view};
}

// Nothing can be made of numbers that are none. False: the parameter is to be ignored.
bool ParamReader::without_nan(Param& p) {
  if (std::ranges::none_of(p.reals, [](float v) { return std::isnan(v); })) return true;
  const bool one = p.reals.size() == 1;
  warnings_.add(p.location, "parameter \"" + p.name + "\" is not a number (nan): " + (one ? "ignored" : "0 is used there"));
  std::vector<float> numbers(p.reals.begin(), p.reals.end());
  for (float& v : numbers)
    if (std::isnan(v)) v = 0;
  p.reals = BulkArray<float>(std::move(numbers));
  return !one;
}

BulkArray<float> ParamReader::reals(Lexer& lexer, bool finite) {
  const Token t = lexer.next();
  if (t.kind == Token::Kind::open) return lexer.read_floats(finite);
  if (t.kind != Token::Kind::number)
    throw SceneError(lexer.location(t), "expected a number or '[', found " + Lexer::describe(t));
  const float v = lexer.to_float(t);
  if (finite && !std::isfinite(v))
    throw SceneError(lexer.location(t), "the number is too large for a float");
  return BulkArray<float>(std::vector<float>{v});
}

BulkArray<std::int32_t> ParamReader::integers(Lexer& lexer, const Param& p) {
  const Token t = lexer.next();
  std::uint64_t fractions = 0;
  BulkArray<std::int32_t> out;
  if (t.kind == Token::Kind::open)
    out = lexer.read_integers(fractions);
  else if (t.kind == Token::Kind::number)
    out = BulkArray<std::int32_t>({lexer.to_integer(t, fractions)});
  else
    throw SceneError(lexer.location(t),
                     "expected a whole number or '[', found " + Lexer::describe(t));
  if (fractions != 0)
    warnings_.add(p.location,
                  "parameter \"" + p.name + "\" of type integer has fractions: cut off");
  return out;
}

BulkArray<std::int32_t> ParamReader::booleans(Lexer& lexer, const Param& p) {
  std::vector<std::int32_t> out;
  bool told = false;
  const auto value = [&](const Token& t) {
    const bool word = t.kind == Token::Kind::word || t.kind == Token::Kind::string;
    const bool known = word && (t.text == "true" || t.text == "false");
    if (!known && (dialect_ == Dialect::v4 || t.kind != Token::Kind::string))
      throw SceneError(lexer.location(t), "expected true or false, found " + Lexer::describe(t));
    if (!known && !std::exchange(told, true))
      warnings_.add(p.location, "the value " + Lexer::describe(t) + " of parameter \"" + p.name + "\" is not true or false: false is used, as in pbrt");
    out.push_back(t.text == "true");
  };
  Token t = lexer.next();
  if (t.kind == Token::Kind::open)
    for (t = lexer.next(); t.kind != Token::Kind::close; t = lexer.next()) value(t);
  else
    value(t);
  return BulkArray<std::int32_t>(std::move(out));
}

std::vector<std::string> ParamReader::strings(Lexer& lexer) {
  std::vector<std::string> out;
  const auto value = [&](const Token& t) {
    if (t.kind != Token::Kind::string)
      throw SceneError(lexer.location(t),
                       "expected a string in quotes, found " + Lexer::describe(t));
    out.push_back(Lexer::unescape(t.text));
  };
  Token t = lexer.next();
  if (t.kind == Token::Kind::open)
    for (t = lexer.next(); t.kind != Token::Kind::close; t = lexer.next()) value(t);
  else
    value(t);
  return out;
}

Rgb ParamReader::from_samples(SampledSpectrum samples) const {
  samples.ends = dialect_ == Dialect::v4;
  if (dialect_ != Dialect::v4) return spectrum_to_rgb(std::move(samples), dialect_);
  return use_ == SpectrumUse::light ? illuminant_to_rgb(std::move(samples))
                                    : reflectance_to_rgb(std::move(samples));
}

Rgb ParamReader::from_blackbody(std::span<const float> v) const {
  const Rgb c = blackbody_to_rgb(static_cast<double>(v[0]), dialect_);
  if (dialect_ != Dialect::v4) return v[1] * c;
  const float y = luminance(c);
  return use_ == SpectrumUse::light && y > 0.f ? c / y : c;
}

Rgb ParamReader::spectrum_called(const std::string& name, Lexer& lexer, const Token& where) {
  if (dialect_ == Dialect::v4)
    if (const auto known = named_spectrum(name)) return *known;
  const std::string path = paths_.find(name, *lexer.source().name(), lexer.location(where));
  auto known = spd_files_.find({use_, path});
  if (known == spd_files_.end()) {
    if (dialect_ == Dialect::v4 && !std::filesystem::exists(path))
      throw SceneError(lexer.location(where), "there is no spectrum and no file '" + name +
                                                  "'; known spectra are " + named_spectra());
    Rgb c(0.f);
    if (dialect_ != Dialect::v4 && !std::filesystem::exists(path))
      warnings_.add(lexer.location(where), "there is no spectrum file '" + name + "': black is used, as in pbrt");
    else
      c = from_samples(read_spd(path, lexer.location(where)));
    known = spd_files_.emplace(std::pair(use_, path), c).first;
  }
  return known->second;
}

BulkArray<float> ParamReader::spectrum(Lexer& lexer, const Param& p) {
  std::vector<Token> tokens;
  Token t = lexer.next();
  if (t.kind == Token::Kind::open)
    for (t = lexer.next(); t.kind != Token::Kind::close; t = lexer.next()) {
      if (t.kind != Token::Kind::number && t.kind != Token::Kind::string)
        throw SceneError(lexer.location(t),
                         "expected wavelengths and values, or the name of a .spd file, found " +
                             Lexer::describe(t));
      if (tokens.size() == kMostSamples)
        throw SceneError(lexer.location(t), "the spectrum has too many samples");
      tokens.push_back(t);
    }
  else
    tokens.push_back(t);

  if (!tokens.empty() && tokens.front().kind == Token::Kind::string) {
    std::vector<Rgb> colors;
    for (const Token& name : tokens) {
      if (name.kind != Token::Kind::string)
        throw SceneError(lexer.location(name),
                         "expected the name of a .spd file, found " + Lexer::describe(name));
      colors.push_back(spectrum_called(Lexer::unescape(name.text), lexer, name));
    }
    return from_colors(colors);
  }
  SampledSpectrum s;
  for (std::size_t i = 0; i + 1 < tokens.size(); i += 2) {
    s.wavelengths.push_back(static_cast<double>(lexer.to_float(tokens[i])));
    s.values.push_back(static_cast<double>(lexer.to_float(tokens[i + 1])));
    if (!std::isfinite(s.wavelengths.back()) || !std::isfinite(s.values.back()))
      throw SceneError(lexer.location(tokens[i]), "the number is too large for a float");
  }
  if (s.values.empty())
    throw SceneError(p.location, "parameter \"" + p.name +
                                     "\" needs pairs of wavelength and value, or a .spd file");
  if (tokens.size() % 2 != 0)
    warnings_.add(p.location, "the last wavelength of \"" + p.name + "\" has no value: ignored");
  return from_colors({from_samples(std::move(s))});
}

}  // namespace cloudrenderer
