// The directives that change the current transformation matrix.
#include <array>
#include <cmath>

#include "scene/parser.h"

namespace cloudrenderer {

void Parser::apply(const Token& t, const DMat4& m, bool replaces) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!(std::fabs(m[c][r]) <= static_cast<double>(std::numeric_limits<float>::max())))
        throw SceneError(location(t), std::string(t.text) + " has a number that is too large");
  if (!transforms_active_) return;
  const DMat4 next = replaces ? m : ctm_ * m;
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!(std::fabs(next[c][r]) <= static_cast<double>(std::numeric_limits<float>::max())))
        throw SceneError(location(t), std::string(t.text) + " makes the transformation too large");
  ctm_ = next;
}

double Parser::read_number(const Token& directive) {
  const Token t = lexer().next();
  if (t.kind != Token::Kind::number)
    throw SceneError(location(t), std::string(directive.text) + ": expected a number, found " +
                                      Lexer::describe(t));
  return lexer().to_double(t);
}

DVec3 Parser::read_vector(const Token& directive) {
  DVec3 v{};
  for (int i = 0; i < 3; ++i) v[i] = read_number(directive);
  return v;
}

DMat4 Parser::read_matrix(const Token& directive) {
  const bool bracketed = lexer().peek().kind == Token::Kind::open;
  if (bracketed) lexer().next();
  DMat4 m;
  for (int c = 0; c < 4; ++c)  // pbrt lists the columns
    for (int r = 0; r < 4; ++r) m[c][r] = read_number(directive);
  if (bracketed)
    if (const Token close = lexer().next(); close.kind != Token::Kind::close)
      throw SceneError(location(close), std::string(directive.text) +
                                            ": expected ']' after 16 numbers, found " +
                                            Lexer::describe(close));
  return m;
}

void Parser::identity(const Token& t) { apply(t, DMat4(1.0), true); }

void Parser::look_at_directive(const Token& t) {
  const DVec3 eye = read_vector(t), look = read_vector(t), up = read_vector(t);
  const auto m = look_at(eye, look, up);
  if (!m)
    warnings_.add(location(t), "LookAt has no direction, or it points along up: ignored");
  else
    apply(t, *m, false);
}

void Parser::scale_directive(const Token& t) { apply(t, scale(read_vector(t)), false); }

void Parser::rotate_directive(const Token& t) {
  const double degrees = read_number(t);
  const DVec3 axis = read_vector(t);
  const auto m = rotate(degrees, axis);
  if (!m)
    warnings_.add(location(t), "Rotate has no axis: ignored");
  else
    apply(t, *m, false);
}

void Parser::translate_directive(const Token& t) { apply(t, translate(read_vector(t)), false); }
void Parser::transform(const Token& t) { apply(t, read_matrix(t), true); }
void Parser::concat_transform(const Token& t) { apply(t, read_matrix(t), false); }

void Parser::coordinate_system(const Token&) {
  coordinate_systems_[read_string("the name of a coordinate system")] = ctm_;
}

void Parser::coord_sys_transform(const Token& t) {
  const std::string name = read_string("the name of a coordinate system");
  const auto found = coordinate_systems_.find(name);
  if (found == coordinate_systems_.end())
    warnings_.add(location(t), "there is no coordinate system \"" + name + "\": ignored");
  else
    apply(t, found->second, true);
}

// Without motion, what holds is the transformation at the start of the shutter interval.
void Parser::active_transform(const Token& t) {
  const Token time = lexer().next();
  if (time.text != "StartTime" && time.text != "EndTime" && time.text != "All")
    throw SceneError(location(time),
                     "expected StartTime, EndTime or All, found " + Lexer::describe(time));
  transforms_active_ = time.text != "EndTime";
  if (!transforms_active_)
    builder_.warn_once(location(t),
                       "moving objects are not supported: they stand where they start");
}

void Parser::transform_times(const Token& t) {
  read_number(t);
  read_number(t);
}

}  // namespace cloudrenderer
