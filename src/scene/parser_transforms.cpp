// The directives that change the current transformation matrix.
#include <array>
#include <cmath>

#include "base/animated_transform.h"
#include "scene/parser.h"

namespace cloudrenderer {

void Parser::apply(const Token& t, const DMat4& m, bool replaces) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!(std::fabs(m[c][r]) <= static_cast<double>(std::numeric_limits<float>::max())))
        throw SceneError(location(t), std::string(t.text) + " has a number that is too large");
  if (active_ != Active::all && !ctm_.end) ctm_.end = ctm_.start;
  if (active_ != Active::end) apply(t, m, replaces, ctm_.start);
  if (!ctm_.end) return;
  if (active_ != Active::start) apply(t, m, replaces, *ctm_.end);
  if (*ctm_.end == ctm_.start) ctm_.end.reset();
}

void Parser::apply(const Token& t, const DMat4& m, bool replaces, DMat4& to) {
  const DMat4 next = replaces ? m : to * m;
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!(std::fabs(next[c][r]) <= static_cast<double>(std::numeric_limits<float>::max())))
        throw SceneError(location(t), std::string(t.text) + " makes the transformation too large");
  to = next;
}

Parser::Ctm Parser::Ctm::inverse() const {
  Ctm out{glm::inverse(start), std::nullopt};
  if (end) out.end = glm::inverse(*end);
  return out;
}

std::optional<Motion> Parser::motion(const FileLocation& where, const char* what) {
  if (!ctm_.end) return std::nullopt;
  const SceneDescription& scene = builder_.scene();
  Motion m{to_transform(*ctm_.end), scene.transform_start, scene.transform_end};
  const Transform start = to_transform(ctm_.start);
  if (m.end == start) return std::nullopt;  // in float
  const char* why = !m.end.is_invertible()                                             ? " cannot be inverted at its end"
                    : !AnimatedTransform::can_move(start.matrix(), m.end.matrix()) ? " is mirrored at one end only"
                                                                                       : nullptr;
  if (!why) return m;
  builder_.warn_once(where, std::string("the movement of the ") + what + why + ": it stands where it starts");
  return std::nullopt;
}

void Parser::stands_still(const FileLocation& where, const char* what) {
  if (ctm_.end) builder_.warn_once(where, std::string("a ") + what + " does not move, as in pbrt: it stands where it starts");
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
    ctm_ = found->second;  // as in pbrt, whichever is active
}

void Parser::active_transform(const Token&) {
  const Token time = lexer().next();
  if (time.text == "All")
    active_ = Active::all;
  else if (time.text == "StartTime")
    active_ = Active::start;
  else if (time.text == "EndTime")
    active_ = Active::end;
  else
    throw SceneError(location(time),
                     "expected StartTime, EndTime or All, found " + Lexer::describe(time));
}

void Parser::transform_times(const Token& t) {
  const auto time = [&] {
    const FileLocation where = location(lexer().peek());
    const double v = read_number(t);
    if (!(std::fabs(v) <= static_cast<double>(std::numeric_limits<float>::max())))
      throw SceneError(where, "TransformTimes: a time must be finite");
    return static_cast<float>(v);
  };
  const FileLocation where = location(lexer().peek());
  const float start = time(), end = time();
  if (!in_options(t)) return;
  if (!(start <= end)) throw SceneError(where, "TransformTimes: the end must not be before the start");
  builder_.scene().transform_start = start;
  builder_.scene().transform_end = end;
}

}  // namespace cloudrenderer
