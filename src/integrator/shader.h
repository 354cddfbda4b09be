#pragma once
// Inside src/integrator only: what shading a batch is made of.
#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>
#include <type_traits>

#include "integrator/path_tracer.h"
#include "shading/subsurface.h"
#include "shapes/surface.h"
#include "shapes/triangle.h"

namespace cloudrenderer {

// What the four pairs of numbers of a vertex are for. The first one may be left out (PathTracer::first_pair_).
enum VertexPair : std::size_t { kLightChoice = 0, kLightPoint = 1, kLobeAndRoulette = 2, kDirection = 3 };

constexpr std::uint16_t kMaxPassed = 1000;  // null surfaces in a row of one path: none is endless
constexpr float kConnect = 2.f / 3.f;  // chance that a path from a light ends where it may, and is seen by the camera

// The power heuristic (Veach 1995). Of the ratio, since densities of tiny lights have squares beyond a float's range.
template <class F>
F power_weight(F a, F b) {
  const F ratio = b / a;
  return lanes::select(a > 0.f, 1.f / (1.f + ratio * ratio), F(0.f));
}

// Of a weight by the power heuristic, with one more technique that is `ratio` times as likely.
template <class F>
F with_light_paths(F weight, F ratio) {
  const F r = lanes::min(ratio, F(1e18f));
  return weight / (1.f + weight * r * r);
}

// Shadow rays stop a little (relative) before the light's surface.
template <class F>
F shadow_length(F distance) {
  return lanes::select(distance < 1e18f, distance * (1.f - 1e-4f), F(1e18f));
}

// Light that arrives if its ray is free: the rays apart from what they are for.
struct PathTracer::Shadows {
  struct Light {
    Fixed3 contribution{};
    std::uint32_t path = 0;  // index into continuing or ended
    bool path_ended = false;
  };
  std::vector<OcclusionRay> rays;
  std::vector<Light> lights;
  std::vector<float> times;  // of the rays, where something moves
};

// A vertex where a path scatters; F: one path's, or eight in lanes.
template <class F>
struct ScatterOf {
  Vec3Of<F> p, ng, ns;
  Vec3Of<F> offset;  // of new rays, see ray_offset
  Vec3Of<F> wo;
  std::array<Vec2Of<F>, 4> numbers;
  IntOf<F> vertex;  // surfaces scattered at before this one
  // Before and, where the path goes on, after.
  Vec3Of<F> throughput;
  // Of paths whose sample shares its camera ray: as many as do, and whether it brings the light of the light sample.
  bool shares = false;
  F group{1.f};
  MaskOf<F> leads{true};

  // Found by scatter(): a shadow ray is to be counted, and traced with light that arrives if it is free ...
  MaskOf<F> asks{false};
  Vec3Of<F> light_origin, light_direction, light{F(0)};
  F light_distance;
  // ... and the next ray.
  MaskOf<F> goes_on{false};
  MaskOf<F> invalid{false};   // ended by a throughput that is not finite
  MaskOf<F> last{false};      // see kLastRay
  MaskOf<F> specular{false};
  Vec3Of<F> side, origin{F(0)}, direction;
  F pdf;
  F ratio{0.f};  // PathSegment::light_ratio, before and after
};

// Of the path `s` that arrives at p.
inline ScatterOf<float> scatter_of(const SurfacePoint& p, const Vec3& offset, const Vec3& wo, const PathSegment& s,
                                   const SampleSequence::Pairs& numbers) {
  ScatterOf<float> v;
  v.p = p.p;
  v.ng = p.ng;
  v.ns = p.ns;
  v.offset = offset;
  v.wo = wo;
  v.vertex = s.vertex;
  for (std::size_t i = 0; i < v.numbers.size(); ++i) v.numbers[i] = numbers[i];
  v.throughput = s.throughput;
  return v;
}

// Where a path leaves the scene: its ray, and of where it has scattered before the point, normal and density.
template <class F>
struct EscapeOf {
  Vec3Of<F> direction, throughput, from, normal;
  F pdf;
};

// What was found at eight vertices, or in row 0 at one, on its way from lanes back to single paths: a row a path, in
// the order in which OcclusionRay and PathSegment keep it.
struct ScatterResults {
  enum Column : std::size_t { light_origin = 0, light_direction = 3, light_distance = 6, light = 7, side = 10, origin = 13,
                              direction = 16, throughput = 19, pdf = 22, ratio = 23, columns = 24 };
  alignas(32) float rows[kLanes][columns];
  std::uint32_t asks, goes_on, invalid, last, specular;  // a bit a lane

  template <class F>
  explicit ScatterResults(const ScatterOf<F>& v)
      : asks(lanes::to_bits(v.asks)),
        goes_on(lanes::to_bits(v.goes_on)),
        invalid(lanes::to_bits(v.invalid)),
        last(lanes::to_bits(v.last)),
        specular(lanes::to_bits(v.specular)) {
    if (asks) keep<F>(0, v.light_origin, v.light_direction, v.light_distance, v.light.x);
    if (asks | goes_on) keep<F>(8, v.light.y, v.light.z, v.side, v.origin);
    if (goes_on) keep<F>(16, v.direction, v.throughput, v.pdf, v.ratio);
  }
  Vec3 get(Column c, std::size_t lane) const { return {rows[lane][c], rows[lane][c + 1], rows[lane][c + 2]}; }

  // The light of all lanes in fixed point, of those whose bit is set in `quantised`: not of black, clamped or invalid light.
  std::uint32_t quantised = 0;
  Fixed3 fixed(std::size_t lane) const { return {columns_[0][lane], columns_[1][lane], columns_[2][lane]}; }
  // As quantise() with these units, a power of two.
  void quantise_light(const Vec3x8& c, double units) {
    using Doubles4 = double __attribute__((vector_size(32)));
    using Longs4 = std::int64_t __attribute__((vector_size(32)));
    // What is smaller than 2^51 is rounded to an integer, ties to even, when this is added.
    constexpr double kInteger = 0x1.8p52;
    const Float8 largest = lanes::max(lanes::abs(c.x), lanes::max(lanes::abs(c.y), lanes::abs(c.z)));
    const Float8 sum = lanes::abs(c.x) + lanes::abs(c.y) + lanes::abs(c.z);  // max() may pass over a NaN
    quantised = lanes::to_bits(sum > 0.f && largest < static_cast<float>(0x1p51 / units));
    for (int channel = 0; channel < 3; ++channel)
      for (std::size_t half = 0; half < 2; ++half) {
        Floats4 four;
        std::memcpy(&four, reinterpret_cast<const float*>(&c[channel].v) + 4 * half, sizeof four);
        const Doubles4 rounded = __builtin_convertvector(four, Doubles4) * units + kInteger;
        const Longs4 integers = reinterpret_cast<Longs4>(rounded) - std::bit_cast<std::int64_t>(kInteger);
        std::memcpy(&columns_[static_cast<std::size_t>(channel)][4 * half], &integers, sizeof integers);
      }
  }

 private:
  alignas(32) std::int64_t columns_[3][kLanes];
  // Eight columns from `first` on.
  template <class F, class... Numbers>
  void keep(std::size_t first, const Numbers&... of) {
    std::array<F, 8> eight;
    std::size_t n = 0;
    (take(eight, n, of), ...);
    if constexpr (std::is_same_v<F, float>) {
      std::copy(eight.begin(), eight.end(), rows[0] + first);
    } else {
      lanes::transpose(eight);
      for (std::size_t i = 0; i < kLanes; ++i) eight[i].store(rows[i] + first);
    }
  }
  template <class F>
  static void take(std::array<F, 8>& eight, std::size_t& n, const F& x) {
    eight[n++] = x;
  }
  template <class F>
  static void take(std::array<F, 8>& eight, std::size_t& n, const Vec3Of<F>& x) {
    eight[n++] = x.x;
    eight[n++] = x.y;
    eight[n++] = x.z;
  }
};

// Shades one batch; holds what the vertices of a batch share.
struct PathTracer::Shader {
  const PathTracer& tracer;
  const ResidentSet& set;
  ShadeOutput& out;
  Shadows& shadows;
  const std::vector<AnsweredSurface>& answered;  // of the batch
  EightShader* eight = nullptr;  // takes vertices that can wait for others
  bool plain_light = false;      // what arrives is neither limited nor attenuated, and shadow rays have no times

  // The path under work, in its batch.
  PathSegment* path = nullptr;
  std::uint16_t end_flags = 0;
  std::uint32_t target = kNone;  // of a path from a light: PathEnd::target
  std::size_t first_shadow = 0;
  // Its surface, where that lies between media.
  Interface interface{};
  Vec3 interface_ng{};

  void begin(PathSegment& segment) {
    path = &segment;
    end_flags = 0;
    target = kNone;
    interface = {};
    first_shadow = shadows.lights.size();
    if (segment.flags & kCameraRay) ++out.counts.camera;
  }
  // Goes on with sample number i, but not the first, of the group that the path under work stands for, in `member`.
  void begin_member(const PathSegment& of, std::uint32_t i, PathSegment& member) {
    member = of;
    member.flags = static_cast<std::uint16_t>(of.flags & ~kHoldsGroup);
    member.sample += 2 * i;
    member.radiance = {};
    resume(member, 0);
  }
  // Samples that share the ray of a path, as long as it is the camera's.
  std::uint32_t group_of(const PathSegment& s) const { return (s.flags & kCameraRay) && (s.flags & kSharesRay) ? tracer.shared_.group : 1; }
  bool leads(const PathSegment& s) const { return tracer.shared_.first(s.sample) == s.sample; }
  // How often light counts that the path sees: for all of its group, or not at all.
  float times_seen(const PathSegment& s) const {
    const std::uint32_t n = group_of(s);
    return n == 1 ? 1.f : leads(s) ? static_cast<float>(n) : 0.f;
  }
  // Each sample of the path's group does f for itself: they share nothing but the ray.
  template <class F>
  void each_alone(F&& f) {
    path->flags = static_cast<std::uint16_t>(path->flags & ~kCameraRay);
    if (!(path->flags & kHoldsGroup)) return f();
    PathSegment member;
    const PathSegment whole = *path;
    const std::uint32_t n = tracer.shared_.group;
    path->flags = static_cast<std::uint16_t>(path->flags & ~kHoldsGroup);
    f();
    for (std::uint32_t i = 1; i < n; ++i) {
      begin_member(whole, i, member);
      f();
    }
  }
  // Goes on with a path that has waited at its vertex.
  void resume(PathSegment& segment, std::uint16_t flags) {
    path = &segment;
    end_flags = flags;
    target = kNone;
    first_shadow = shadows.lights.size();
  }
  bool to_fixed(const Rgb& c, Fixed3& fixed) {
    if (!is_finite(c)) {
      ++out.counts.invalid;
      end_flags |= kEndInvalid;
      return false;
    }
    bool clamped = false;
    for (std::size_t i = 0; i < 3; ++i) fixed[i] = quantise(c[static_cast<int>(i)], tracer.fixed_units_, clamped);
    if (clamped) {
      ++out.counts.clamped;
      end_flags |= kEndClamped;
    }
    return true;
  }
  void add(const Rgb& c) {
    if (is_black(c)) return;
    Fixed3 f;
    if (!to_fixed(c, f)) return;
    for (std::size_t i = 0; i < 3; ++i) path->radiance[i] += f[i];
  }
  // A shadow ray for light c, to be filled in; null if there is nothing to ask for. Made where it stays: numbers that are
  // written one by one and then copied together are waited for.
  OcclusionRay* shadow(const Rgb& c) {
    if (is_black(c)) return nullptr;
    if (!to_fixed(c, shadows.lights.emplace_back().contribution)) {
      shadows.lights.pop_back();
      return nullptr;
    }
    if (tracer.motion_) shadows.times.push_back(tracer.time_of(*path));
    return &shadows.rays.emplace_back();
  }

  SurfacePoint surface(const Vec3& origin, const Vec3& direction, const Hit& hit, std::uint32_t& material, std::uint32_t& light, bool derivatives) const;
  SurfacePoint surface(const AnsweredSurface& s, const Hit& hit, std::uint32_t& material, std::uint32_t& light, bool derivatives) const;
  // How wide the pixel's cone is where the path has come t far; 0: it is not known.
  static float cone_at(const PathSegment& s, float t) { return s.has_light_ratio() ? 0.f : s.cone_width + s.cone_spread * t; }
  // Of a cone of this width along `direction`.
  template <class F>
  static FootprintOf<F> footprint_of(const SurfacePointOf<F>& p, const Vec3Of<F>& direction, F width);
  Footprint footprint(const SurfacePoint& p, float t) const {
    return tracer.footprint_ ? footprint_of(p, path->direction, cone_at(*path, t)) : Footprint{};
  }
  void vertex(const Hit& hit);
  // The path under work at a surface that scatters, which it has hit: at once, or when what its textures read is at hand.
  void scatter_or_wait(std::uint32_t material, SurfacePoint& p, const Vec3& offset, const Footprint& print, const Hit& hit);
  void scatter_at(std::uint32_t material, SurfacePoint& p, const Vec3& offset, const Footprint& print, const Hit& hit);
  // Takes the path under work through the media before its surface at t, or infinity. False: it stays in them, and has
  // been taken on or ended there.
  bool cross_media(float t);
  void scatter_in_medium(const MediumSample& at);
  // Takes the path under work on from where it has collided with a brick.
  void collide(const Hit& hit);
  // pbrt-v2 asks its volume integrator about rays from the camera, and where directlighting follows specular lobes.
  // Everything else is only attenuated.
  bool asks_media() const {
    const std::uint16_t kinds = path->flags & (kSpecularBounce | kLastRay);
    return tracer.job_.integrator == IntegratorKind::direct ? kinds == kSpecularBounce : path->vertex == 0;
  }
  // Of the medium that a ray from the surface under work is in.
  std::uint16_t medium_towards(const Vec3& direction) const {
    if (interface.inside == interface.outside) return path->medium;
    return glm::dot(direction, interface_ng) > 0.f ? interface.outside : interface.inside;
  }
  // How much light comes through the media, and through surfaces without material, from the end of a shadow ray; what
  // is known to block it gives 0.
  Rgb shadow_transmittance(const Vec3& origin, const Vec3& direction, float distance) const;
  // features.cpp, in jobs that ask for them: what the path sees at its vertex, if it has not told yet.
  bool tells_features() const { return tracer.job_.features && !(path->flags & kSurfaceTold); }
  void tell_surface(const Hit& hit, std::uint32_t material, const SurfacePoint& p);
  void tell_collision(const Vec3& p);
  void put_place(PathFeatures& f, const Vec3& p) const;
  void escape();
  // Whether light counts that a path finds outside of the scene.
  bool finds_infinite(const PathSegment& s) const {
    return tracer.infinite_lights_ && (tracer.job_.integrator != IntegratorKind::ambient_occlusion || tracer.dialect_ == Dialect::v2) &&
           (!(s.flags & kSpecularBounce) || s.vertex <= tracer.job_.emission_vertex);
  }
  // Whether light that the path finds comes by paths from lights as well: not what the camera sees lit directly.
  bool shares_with_lights(const PathSegment& s) const {
    if (tracer.light_paths_ == LightPaths::none || !(s.flags & kAnyNonSpecular)) return false;
    return (s.flags & kSpecularBounce) || (tracer.light_paths_ == LightPaths::all && s.vertex >= 2);
  }
  // The path's weight against light samples, and then against paths from lights too. `emission`: see Lights.
  float shared_weight(const PathSegment& s, float weight, float emission) const {
    return shares_with_lights(s) ? with_light_paths(weight, s.light_ratio() * emission * (s.flags & kSpecularBounce ? kConnect : kConnect / (1.f - kConnect)))
                                 : weight;
  }
  // The light of the infinite lights that escaped paths find, weighted against samples of these lights where the paths have
  // scattered; without `weighted` only direction and throughput are read.
  template <class F>
  Vec3Of<F> escaped(MaskOf<F> active, const EscapeOf<F>& e, bool weighted) const;
  // Ends the path under work, or of a sample that has not had one begins its path from a light.
  void end();
  bool begin_light_path();  // light_paths.cpp; false: no light wants it
  bool light_ray(LightRay& ray) const;  // that the sample's path from a light begins with
  void light_vertex(const Hit& hit);
  void connect(Bsdf& bsdf, const SurfacePoint& p, const Vec3& offset, const SampleSequence::Pairs& numbers);
  float choose_pixel(const Vec2& film, float u, std::uint32_t& pixel) const;
  // The side of a vertex whose light matters (see Lights::sample).
  template <class F>
  static Vec3Of<F> lit_side(const BsdfOf<F>& bsdf, const Vec3Of<F>& ns, const Vec3Of<F>& ng, const Vec3Of<F>& wo);
  // How many times likelier a path from the light is than its sample, at a vertex to which the path brings v.ratio.
  template <class F>
  F sample_ratio(const BsdfOf<F>& bsdf, const ScatterOf<F>& v, const LightSampleOf<F>& sample) const;
  // Where a path goes on from a vertex: v.ratio is what it brings there.
  template <class F>
  F light_ratio_behind(const BsdfOf<F>& bsdf, const ScatterOf<F>& v, const BsdfSampleOf<F>& sample) const;
  // Sends the path on; the caller says where, in what is returned.
  PathSegment& next();
  void occlusion(const SurfacePoint& p, const Vec3& offset, const SampleSequence& sequence);
  // Below surfaces: shade_subsurface.cpp.
  struct Step;
  // A vertex on a material with a medium inside: what its BSDF transmits goes into the medium, from whichever side.
  void enter(std::uint32_t material, const InteriorMedium& medium, SurfacePoint& p,
             const Footprint& footprint, float t);
  // Takes the path under work on through the medium that it is in, from the step whose ray has been traced.
  void walk(Hit hit);
  bool walk_meets(const Hit& hit, const Step& step);
  void leave(const SubsurfacePoint& at, const SurfacePoint& p);
  // Mirrors and narrow lobes are widened at the path's vertex.
  bool is_regularized(const PathSegment& s) const { return tracer.job_.regularize && (s.flags & kAnyNonSpecular); }
  // True if the path scatters no more at its vertex.
  bool is_over(const PathSegment& s) const { return (s.flags & kLastRay) || s.vertex >= tracer.job_.light_vertices; }
  // What happens where a path scatters, but for what scattered() does; `active` lanes only.
  template <class F>
  void scatter(const BsdfOf<F>& bsdf, MaskOf<F> active, ScatterOf<F>& v) const;
  bool sample_light(bool active, const Vec3& p, const Vec3& n, float u_light, const Vec2& u, LightSample& sample) const {
    return active && tracer.lights_->sample(p, n, u_light, u, sample);
  }
  Mask8 sample_light(Mask8 active, const Vec3x8& p, const Vec3x8& n, Float8 u_light, const Vec2x8& u,
                     LightSample8& sample) const {
    return tracer.lights_->sample(active, p, n, u_light, u, sample);
  }
  template <class F>
  void direct(const BsdfOf<F>& bsdf, MaskOf<F> active, ScatterOf<F>& v) const;
  // The rest of scatter(): the next ray.
  template <class F>
  void choose_ray(const BsdfOf<F>& bsdf, MaskOf<F> active, ScatterOf<F>& v) const;
  // scatter() and scattered() for the path under work, and for all whom it stands for.
  void scatter_group(const Bsdf& bsdf, ScatterOf<float>& v, float t);
  template <class F>
  void thin_out(ScatterOf<F>& v) const;
  void ask_for_light(const ScatterResults& r, std::size_t lane);
  // Takes the path under work on from its vertex.
  void scattered(const ScatterResults& r, std::size_t lane, float t);
};

// Vertices that wait until there are eight of a kind. Either triangles that shine not, with or without normals and uvs, of
// materials of one kind (Shading::kind): all is done eight at once; or of other materials: their points are found so. Or any surface whose lobes were found one by one, with
// lobes of the same kinds: light samples and the choice of the next ray are then made eight at once. What a vertex gives does
// not depend on the others: a lane has the bits of the scalar formulas.
class PathTracer::EightShader {
 public:
  EightShader(Shader& shader, SegmentBatch& batch);
  // False if the vertex of segment i is to be shaded by itself.
  bool take(std::size_t i);
  // A vertex at p, of the path of the batch that is under work, waits until what its textures read is in the cache. False:
  // it need not.
  bool take_textured(std::uint32_t material, const SurfacePoint& p, const Vec3& offset, const Footprint& print, const PathSegment& s);
  // The same vertex with its lobes. False: it cannot wait.
  bool take(const Bsdf& bsdf, const SurfacePoint& p, const Vec3& offset, const PathSegment& s);
  void finish();  // shades what still waits

 private:
  // Of lobes: all but the numbers, a word a lobe.
  using LobeKinds = std::array<std::uint32_t, Bsdf8::kMaxLobes>;
  struct Waiting {
    LobeKinds kinds{};
    int lobe_count = 0;
    std::size_t count = 0;
    std::array<std::size_t, kLanes> segments;
    std::array<std::uint16_t, kLanes> end_flags;
    Columns<21> at;  // p, ng, offset, frame, the normal that decides the sides
    std::array<LobeOf<Float8>, Bsdf8::kMaxLobes> lobes;
  };
  // Paths that have left the scene, where light comes from: of light samples' other half, and seen directly.
  struct Escapes {
    std::size_t count = 0;
    std::array<std::size_t, kLanes> segments;
  };
  struct Textured {
    std::size_t segment;
    std::uint32_t material;
    std::uint16_t end_flags;
    SurfacePoint p;
    Vec3 offset;
    Footprint print;
  };
  static constexpr std::size_t kTextured = 16;
  static constexpr std::size_t kMostWaiting = 64;  // kinds; scenes with more shade the rest one by one
  struct Group {
    std::size_t count = 0;
    std::array<std::size_t, kLanes> segments;
    std::array<const MeshChunk*, kLanes> chunks;
    std::array<const Part*, kLanes> parts;
  };
  // Eight triangles' corners, and where on them the hits are.
  struct Gathered {
    TriangleVerticesOf<Float8> triangle;
    Vec2x8 at;
    Mask8 flip;
    std::array<std::size_t, kLanes> segments;
    std::array<std::uint32_t, kLanes> materials;
  };
  void find_chunk(const Hit& hit);
  Gathered gather(std::size_t kind, const Group& group) const;
  void shade(std::size_t kind, Group& group);
  void scatter_points(std::size_t kind, Group& group);
  void shade(Waiting& waiting);
  void scatter_textured();
  bool take_escape(std::size_t i);
  void shade(Escapes& escapes, bool weighted);
  // Fills in what paths bring to a vertex.
  void bring(const std::array<std::size_t, kLanes>& segments, ScatterOf<Float8>& v) const;
  // What happens at eight vertices of which `count` are there; end_flags: null for paths that begin to be shaded.
  void scatter(const Bsdf8& bsdf, ScatterOf<Float8>& v, const std::array<std::size_t, kLanes>& segments, std::size_t count,
               const std::uint16_t* end_flags);
  // The other samples of the groups among them; throughput: before the vertex.
  void scatter_members(const Bsdf8& bsdf, ScatterOf<Float8>& v, const std::array<std::size_t, kLanes>& segments, std::uint32_t holding,
                       const Vec3x8& throughput);

  Shader& shader_;
  SegmentBatch& batch_;
  // Of the hit before: neighbours mostly lie on one mesh.
  std::uint32_t part_number_ = kNone;
  const Part* part_ = nullptr;
  const MeshChunk* chunk_ = nullptr;
  bool alone_ = true;      // such triangles are shaded by themselves
  std::size_t group_ = 0;
  std::vector<Group> groups_;  // by 4 * material kind + 2 * normals + uvs; kind 0: only their points eight at once
  std::vector<std::unique_ptr<Waiting>> waiting_;
  std::size_t last_waiting_ = 0;
  std::vector<Textured> textured_;
  std::array<Escapes, 2> escapes_;  // seen directly; weighted
};

}  // namespace cloudrenderer
