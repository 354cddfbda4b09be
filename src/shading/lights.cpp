#include "shading/lights.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <type_traits>

#include "parts/part_triangle.h"
#include "scene/dialect.h"
#include "shading/light_infinite.h"
#include "shading/light_map.h"
#include "shading/light_rays.h"
#include "shading/light_record.h"

namespace cloudrenderer {
namespace {

class SceneLights final : public Lights {
 public:
  SceneLights(const SceneDescription& scene, std::span<const AreaLightId> shape_lights,
              const Part& part, const Bounds3& bounds, Warnings& warnings, bool read_maps) {
    for (const LightDesc& desc : scene.lights) add_light(desc, scene.dialect, warnings, read_maps);
    emissions_ = read_emissions(scene, shape_lights, warnings, read_maps);
    emits_ = std::ranges::any_of(emissions_, [](const Emission& e) { return !is_black(e.radiance); });
    is_mesh_.resize(emissions_.size());
    add_shapes(part, scene.dialect, is_of_v4(scene));
    choice_ = LightChoice(bounds_, points_);
    rays_ = LightRays({emitters_, spots_, maps_, quadrics_, infinite_, pictures_}, bounds);
    bounds_ = {};
    points_ = {};
  }

  bool empty() const override { return emitters_.empty() && !emits_; }
  bool has_infinite() const override { return !infinite_.empty(); }
  bool has_choice() const override { return !emitters_.empty() && !choice_.single(); }
  bool weighs_alone() const override { return std::ranges::any_of(emitters_, [&](const Emitter& e) { return weighs_alone(e); }); }
  bool disagrees() const override {
    const auto turned = [&](const Emitter& e) {
      const bool curved = e.kind == EmitterKind::sphere || e.kind == EmitterKind::sphere_part || e.kind == EmitterKind::quadric;
      return curved && !e.two_sided && quadrics_[e.index].quadric.inside_out;
    };
    return std::ranges::any_of(emitters_, turned);
  }
  std::uint64_t bytes() const override {
    std::uint64_t n = emitters_.size() * sizeof(Emitter) + choice_.bytes() +
                      quadrics_.size() * sizeof(EmissiveQuadric) + by_primitive_.size() * sizeof(std::uint32_t) +
                      emissions_.size() * sizeof(Emission) + powers_.size() * sizeof(float) + rays_.bytes();
    for (const InfiniteLight& light : infinite_) n += light.bytes();
    for (const DirectionalMap& map : maps_) n += map.bytes();
    n += pictures_.size() * sizeof(EmitterPicture);
    return n;
  }

  bool sample(const Vec3& p, const Vec3& n, float u_light, const Vec2& u, LightSample& out) const override {
    if (emitters_.empty()) return false;
    float chance;
    const std::int64_t chosen = choice_.sample(p, n, u_light, chance);
    if (chosen < 0) return false;
    return sample_chosen<float>(true, static_cast<std::size_t>(chosen), chance, p, n, u, out);
  }

  Mask8 sample(Mask8 active, const Vec3x8& p, const Vec3x8& n, Float8 u_light, const Vec2x8& u,
               LightSample8& out) const override {
    Mask8 found(false);
    if (emitters_.empty()) return found;
    if (choice_.single()) return active && sample_eight(active, 0, Float8(1.f), p, n, u, out);
    std::array<std::int64_t, kLanes> chosen;
    Float8 chance(1.f);
    choice_.sample(active, p, n, u_light, chosen, chance);
    // Each round takes the lanes that ask one emitter, or all that ask flat ones.
    const auto flat = [&](std::int64_t number) { return number >= 0 && is_flat(emitters_[static_cast<std::size_t>(number)]); };
    for (std::uint32_t left = lanes::to_bits(active); left;) {
      const std::int64_t number = chosen[static_cast<std::size_t>(std::countr_zero(left))];
      const bool flats = flat(number);
      std::uint32_t round = 0, same = 0;
      for (std::size_t i = 0; i < kLanes; ++i) {
        if (!(left >> i & 1u)) continue;
        same |= static_cast<std::uint32_t>(chosen[i] == number) << i;
        round |= static_cast<std::uint32_t>(chosen[i] == number || (flats && flat(chosen[i]))) << i;
      }
      left &= ~round;
      if (number < 0) continue;
      const Mask8 asking = lanes::from_mask_bits(round);
      const auto ask = [&](LightSample8& to) {
        return asking && (round == same ? sample_eight(asking, static_cast<std::size_t>(number), chance, p, n, u, to)
                                        : sample_flats(round, chosen, chance, p, u, to));
      };
      if (round == lanes::to_bits(active)) return ask(out);
      LightSample8 own;
      found = found || ask(own);
      out.wi = lanes::select(asking, own.wi, out.wi);
      out.distance = lanes::select(asking, own.distance, out.distance);
      out.radiance = lanes::select(asking, own.radiance, out.radiance);
      out.pdf = lanes::select(asking, own.pdf, out.pdf);
      out.weight_pdf = lanes::select(asking, own.weight_pdf, out.weight_pdf);
      out.emission = lanes::select(asking, own.emission, out.emission);
      out.delta = lanes::select(asking, own.delta, out.delta);
    }
    return found;
  }

  Rgb escaped(const Vec3& p, const Vec3& n, const Vec3& direction, float& pdf) const override {
    return all_infinite<float>(true, p, n, direction, pdf);
  }
  Vec3x8 escaped(Mask8 active, const Vec3x8& p, const Vec3x8& n, const Vec3x8& direction, Float8& pdf) const override {
    return all_infinite<Float8>(active, p, n, direction, pdf);
  }
  Rgb escaped(const Vec3& p, const Vec3& direction) const override { return all_infinite<float>(true, p, direction); }
  Vec3x8 escaped(Mask8 active, const Vec3x8& p, const Vec3x8& direction) const override { return all_infinite<Float8>(active, p, direction); }

  Rgb emitted(std::uint32_t light, const Vec3& ng, const Vec3& direction, std::uint32_t primitive, const Vec2& uv) const override {
    const Emission& e = emissions_[light];
    if (!(e.two_sided || glm::dot(ng, direction) < 0.f)) return Rgb(0.f);
    const Rgb radiance = e.picture && is_mesh_[light] ? e.scale * clamped(*e.picture, uv) : e.radiance;
    return e.power > 0.f ? radiance * power_factor(light, primitive) : radiance;
  }
  bool is_only_seen(std::uint32_t light) const override { return emissions_[light].only_seen; }
  bool has_pictures() const override { return std::ranges::any_of(emissions_, [](const Emission& e) { return e.picture != nullptr; }); }

  float emitted_pdf(std::uint32_t light, const Vec3& p, const Vec3& n, const Vec3& direction,
                    float t, const Vec3&, const Vec3& hit_ng,
                    std::uint32_t primitive) const override {
    const std::uint32_t number = emitter_of(light, primitive);
    if (number == kNone) return 0.f;
    const Emitter& e = emitters_[number];
    float pdf = shape_pdf(e, p, direction, t, hit_ng);
    if (!weighs_alone(e)) pdf *= choice_.chance(number, p, n);
    return pdf < kInfinity ? pdf : 0.f;
  }

  bool emit(float u_light, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const override {
    return rays_.emit(u_light, u_point, u_direction, out);
  }
  void want_emission() override { wants_emission_ = true; }
  void aim(std::span<const Bounds3> boxes, float share) override { rays_.aim(boxes, share); }
  float emission(std::uint32_t emitter, const Vec3& p, const Vec3& wi, float distance) const override {
    return rays_.emission(emitter, p, wi, distance);
  }
  float shape_emission(std::uint32_t light, std::uint32_t primitive, const Vec3& point, const Vec3& direction) const override {
    const std::uint32_t number = emitter_of(light, primitive);
    return number == kNone || emitters_[number].invisible ? 0.f : rays_.emission(number, point, direction, 0.f);
  }
  float infinite_emission(const Vec3& p, const Vec3& direction) const override { return rays_.infinite_emission(p, direction); }
  float pdf_of(const LightRay& ray, const Vec3& p, const Vec3& n) const override {
    const Emitter& e = emitters_[ray.emitter];
    float pdf = 1;
    if (e.kind == EmitterKind::infinite) {
      (void)all_infinite<float>(true, p, n, -ray.direction, pdf);
      return pdf;
    }
    const Vec3 way = ray.origin - p;
    const float distance = glm::length(way);
    if (e.kind >= EmitterKind::triangle) pdf = shape_pdf(e, p, way / distance, distance, ray.normal);
    return pdf * choice_.chance(ray.emitter, p, n);
  }

 private:
  // By solid angle, of a point of e seen from p; its normal is ng.
  float shape_pdf(const Emitter& e, const Vec3& p, const Vec3& direction, float t, const Vec3& ng) const {
    switch (e.kind) {
      case EmitterKind::sphere:
        return sphere_pdf(e, p);
      case EmitterKind::triangle:
      case EmitterKind::parallelogram:
      case EmitterKind::disk:
        return flat_pdf(e, p, direction, t);
      case EmitterKind::sphere_part:
        return sphere_part_pdf(quadrics_[e.index], p, direction);
      case EmitterKind::quadric:
        return quadric_pdf(quadrics_[e.index], direction, t, ng);
      default:
        return 0.f;
    }
  }
  // Of a primitive of the emissive shape `light`; kNone: it cannot be sampled.
  std::uint32_t emitter_of(std::uint32_t light, std::uint32_t primitive) const {
    const PrimitiveRange& range = ranges_[light];
    const std::uint32_t i = range.count == 1 ? 0 : primitive;  // quadrics have one entry, whatever their primitive number is
    return i < range.count ? by_primitive_[range.first + i] : kNone;
  }

  // A disk of pbrt-v2 samples one side and shows light on the other (make_disk). The two estimates do not add up to
  // the whole light, so the picture depends on their weights, and these are pbrt-v2's: the light's own density,
  // without the chance of the light. So it does for lamps that samples find and rays do not (Emission::weighed).
  bool weighs_alone(const Emitter& e) const {
    if (e.invisible) return e.weighed;
    if (e.kind != EmitterKind::quadric || e.two_sided) return false;
    const Quadric& q = quadrics_[e.index].quadric;
    return q.kind == QuadricKind::disk && q.inside_out;
  }

  template <class F>
  Vec3Of<F> all_infinite(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& n, const Vec3Of<F>& direction, F& pdf) const {
    Vec3Of<F> sum(F(0.f));
    pdf = 0.f;
    for (std::size_t i = 0; i < infinite_.size(); ++i) {
      F density;
      sum += infinite_[i].radiance_and_pdf_at<F>(active, p, n, direction, density);
      const MaskOf<F> possible = active && density > 0.f;
      if (!choice_.single())
        lanes::for_each(possible, [&](std::size_t lane) {
          const float chance = choice_.chance(infinite_emitters_[i], lanes::get(p, lane), lanes::get(n, lane));
          lanes::put(density, lane, lanes::get(density, lane) * chance);
        });
      pdf = lanes::select(possible, pdf + density, pdf);
    }
    return sum;
  }
  template <class F>
  Vec3Of<F> all_infinite(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& direction) const {
    Vec3Of<F> sum(F(0.f));
    for (const InfiniteLight& light : infinite_) sum += light.radiance<F>(active, p, direction);
    return sum;
  }

  // An emitter that has been chosen with `chance`.
  template <class F>
  MaskOf<F> sample_chosen(MaskOf<F> active, std::size_t number, F chance, const Vec3Of<F>& p, const Vec3Of<F>& n, const Vec2Of<F>& u,
                          LightSampleOf<F>& out) const {
    const Emitter& e = emitters_[number];
    const MaskOf<F> found = sample_emitter<F>(active, e, p, n, u, out);
    if (!lanes::any(found)) return found;
    const F own_pdf = out.pdf;
    out.pdf *= chance;
    // Every infinite light could have given this direction, and all of them shine from there.
    if (e.kind == EmitterKind::infinite && infinite_.size() > 1)
      out.radiance = all_infinite<F>(found, p, n, out.wi, out.pdf);
    out.weight_pdf = weighs_alone(e) ? own_pdf : out.pdf;
    if (e.invisible && !e.weighed) out.delta = MaskOf<F>(true);
    add_of_point(found, [number](std::size_t) { return number; }, p, out);
    return found && out.pdf > 0.f && out.pdf < kInfinity;
  }

  // The same for flat emitters, one for each of the lanes `asking`.
  Mask8 sample_flats(std::uint32_t asking, const std::array<std::int64_t, kLanes>& chosen, Float8 chance, const Vec3x8& p, const Vec2x8& u,
                     LightSample8& out) const {
    const auto any = static_cast<std::size_t>(std::countr_zero(asking));
    const auto number = [&](std::size_t i) { return static_cast<std::size_t>(chosen[asking >> i & 1u ? i : any]); };
    std::array<const Emitter*, kLanes> emitters;
    std::uint32_t alone = 0, hidden = 0;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Emitter& e = emitters_[number(i)];
      emitters[i] = &e;
      alone |= static_cast<std::uint32_t>(weighs_alone(e)) << i;
      hidden |= static_cast<std::uint32_t>(e.invisible && !e.weighed) << i;
    }
    const Mask8 found = sample_flat<Float8>(flats_of(emitters), p, u, out);
    const Float8 own_pdf = out.pdf;
    out.pdf *= chance;
    out.weight_pdf = lanes::select(lanes::from_mask_bits(alone), own_pdf, out.pdf);
    out.delta = lanes::from_mask_bits(hidden);
    add_of_point(found && lanes::from_mask_bits(asking), number, p, out);
    return found && out.pdf > 0.f && out.pdf < kInfinity;
  }

  // What depends on the emitter's point that has been found; `number` says the emitter of a lane.
  template <class F, class Number>
  void add_of_point(MaskOf<F> found, const Number& number, const Vec3Of<F>& p, LightSampleOf<F>& out) const {
    if (!pictures_.empty())
      lanes::for_each(found, [&](std::size_t i) {
        const std::uint32_t picture = emitters_[number(i)].picture;
        if (picture == kNone) return;
        lanes::put(out.radiance, i, pictures_[picture].radiance(lanes::get(p, i) + lanes::get(out.wi, i) * lanes::get(out.distance, i)));
      });
    if (wants_emission_)
      lanes::for_each(found, [&](std::size_t i) {
        lanes::put(out.emission, i, rays_.emission(static_cast<std::uint32_t>(number(i)), lanes::get(p, i), lanes::get(out.wi, i), lanes::get(out.distance, i)));
      });
  }

  template <class F>
  MaskOf<F> sample_emitter(MaskOf<F> active, const Emitter& e, const Vec3Of<F>& p, const Vec3Of<F>& n, const Vec2Of<F>& u,
                           LightSampleOf<F>& out) const {
    switch (e.kind) {
      case EmitterKind::sphere:
        return sample_sphere<F>(e, p, u, out);
      case EmitterKind::triangle:
      case EmitterKind::parallelogram:
      case EmitterKind::disk:
        return sample_flat<F>(flat_of<F>(e), p, u, out);
      case EmitterKind::point:
        return sample_point<F>(e, p, out);
      case EmitterKind::spot:
        return sample_spot<F>(e, spots_[e.index], p, out);
      case EmitterKind::distant:
        return sample_distant<F>(e, out);
      case EmitterKind::infinite:
        out.distance = kInfinity;
        out.delta = MaskOf<F>(false);
        return infinite_[e.index].sample_at<F>(active, p, n, u, out.wi, out.pdf, out.radiance);
      default:
        break;
    }
    if constexpr (std::is_same_v<F, float>) {
      switch (e.kind) {
        case EmitterKind::sphere_part:
          return sample_sphere_part(e, quadrics_[e.index], p, u, out);
        case EmitterKind::quadric:
          return sample_quadric(e, quadrics_[e.index], p, u, out);
        case EmitterKind::mapped:
          return sample_mapped(e, maps_[e.index], p, out);
        default:
          break;
      }
    }
    return MaskOf<F>(false);
  }

  // Kinds without formulas for eight are asked one by one.
  Mask8 sample_eight(Mask8 asking, std::size_t number, Float8 chance, const Vec3x8& p, const Vec3x8& n, const Vec2x8& u,
                     LightSample8& out) const {
    switch (emitters_[number].kind) {
      case EmitterKind::sphere:
      case EmitterKind::triangle:
      case EmitterKind::parallelogram:
      case EmitterKind::disk:
      case EmitterKind::point:
      case EmitterKind::spot:
      case EmitterKind::distant:
      case EmitterKind::infinite:
        return sample_chosen<Float8>(asking, number, chance, p, n, u, out);
      default:
        break;
    }
    std::uint32_t found = 0;
    lanes::for_each(asking, [&](std::size_t i) {
      LightSample one;
      if (!sample_chosen<float>(true, number, lanes::get(chance, i), lanes::get(p, i), lanes::get(n, i),
                                {lanes::get(u.x, i), lanes::get(u.y, i)}, one))
        return;
      found |= 1u << i;
      lanes::put(out.wi, i, one.wi);
      lanes::put(out.distance, i, one.distance);
      lanes::put(out.radiance, i, one.radiance);
      lanes::put(out.pdf, i, one.pdf);
      lanes::put(out.weight_pdf, i, one.weight_pdf);
      lanes::put(out.emission, i, one.emission);
      if (one.delta) out.delta = out.delta || lanes::from_mask_bits(1u << i);
    });
    return lanes::from_mask_bits(found);
  }

  std::uint32_t add(const EmitterAndBounds& e) {
    emitters_.push_back(e.emitter);
    bounds_.push_back(e.bounds);
    points_.push_back(e.points);
    return static_cast<std::uint32_t>(emitters_.size() - 1);
  }

  void add_light(const LightDesc& desc, Dialect dialect, Warnings& warnings, bool read_maps) {
    std::optional<EmitterAndBounds> made;
    if (desc.type == "point") {
      made = make_point(desc, warnings);
    } else if (desc.type == "spot") {
      SpotCone cone;
      made = make_spot(desc, cone, warnings);
      if (made) {
        made->emitter.index = static_cast<std::uint32_t>(spots_.size());
        spots_.push_back(cone);
      }
    } else if (desc.type == "goniometric" || desc.type == "projection") {
      const auto kind = desc.type == "projection" ? DirectionalMap::Kind::projection : DirectionalMap::Kind::goniometric;
      DirectionalMap map(kind, desc, dialect, read_maps, warnings);
      made = make_mapped(desc, map, warnings);
      if (made) {
        made->emitter.index = static_cast<std::uint32_t>(maps_.size());
        maps_.push_back(std::move(map));
      }
    } else if (desc.type == "distant") {
      made = make_distant(desc, warnings);
    } else if (desc.type == "infinite" || desc.type == "exinfinite") {
      InfiniteLight light(desc, dialect, warnings, read_maps);
      EmitterAndBounds e;
      e.emitter.kind = EmitterKind::infinite;
      e.emitter.index = static_cast<std::uint32_t>(infinite_.size());
      e.bounds.shape = EmitterShape::everywhere;
      e.bounds.strength = kPi * average(light.mean());  // what it gives a surface that sees half of it
      if (e.bounds.strength > 0.f) {
        infinite_.push_back(std::move(light));
        infinite_emitters_.push_back(add(e));
      }
    } else {
      warnings.add(desc.location, "light \"" + desc.type + "\" is not supported and left out");
      return;
    }
    if (made) add(*made);
    desc.params.report_unused("LightSource \"" + desc.type + "\"", warnings);
  }

  void add_shapes(const Part& part, Dialect dialect, bool v4) {
    for (const MeshChunk& chunk : part.chunks)
      if (shines(chunk.light)) is_mesh_[chunk.light] = true;
    ranges_ = primitive_ranges(part, emissions_);
    const std::uint32_t total = ranges_.empty() ? 0 : ranges_.back().first + ranges_.back().count;
    by_primitive_.assign(total, kNone);
    if (std::ranges::any_of(emissions_, [](const Emission& e) { return e.power > 0.f; })) powers_ = power_factors(part, emissions_, ranges_, total);
    // In pbrt-v4 a texture that makes holes makes the light unfit for sampling by area; rays that hit it count in full. Before it
    // samples know nothing of holes.
    const auto by_area = [&](std::uint32_t alpha, const Emission& e) { return alpha == kNone || e.invisible || !v4; };
    for (const MeshChunk& chunk : part.chunks)
      if (shines(chunk.light) && by_area(chunk.alpha_texture, emissions_[chunk.light]))
        add_mesh(chunk, part, dialect);
    for (const QuadricRecord& record : part.quadrics) {
      if (!shines(record.light)) continue;
      const Emission& emission = emissions_[record.light];
      if (!by_area(record.alpha_texture, emission)) continue;
      EmissiveQuadric quadric;
      const Rgb radiance = emission.power > 0.f ? emission.radiance * power_factor(record.light, 0) : emission.radiance;
      auto made = make_quadric(record.quadric, record.flip != 0, radiance, emission.two_sided, quadric);
      if (!made || !(made->bounds.strength > 0.f)) continue;
      made->emitter.index = static_cast<std::uint32_t>(quadrics_.size());
      made->emitter.hide(emission);
      quadrics_.push_back(quadric);
      by_primitive_[ranges_[record.light].first] = add(*made);
    }
  }

  bool shines(std::uint32_t light) const { return can_be_sampled(emissions_, light); }

  float power_factor(std::uint32_t light, std::uint32_t primitive) const {
    const PrimitiveRange& range = ranges_[light];
    const std::uint32_t i = range.count == 1 ? 0 : primitive;
    return i < range.count ? powers_[range.first + i] : 0.f;
  }

  void add_mesh(const MeshChunk& chunk, const Part& part, Dialect dialect) {
    const Emission& emission = emissions_[chunk.light];
    if (!(average(emission.radiance) > 0.f)) return;
    const auto primitive = [&](std::uint32_t i) { return part.source_primitive(chunk, chunk.first_triangle + i); };
    const auto slot = [&](std::uint32_t i) -> std::uint32_t& { return by_primitive_[ranges_[chunk.light].first + primitive(i)]; };
    const auto radiance = [&](std::uint32_t i) {
      if (!(emission.power > 0.f)) return emission.radiance;
      return emission.radiance * power_factor(chunk.light, primitive(i));
    };
    const auto normal = [&](const TriangleVertices& t) { return triangle_point(t, chunk.flip != 0, dialect, 1.f / 3.f, 1.f / 3.f, false).ng; };
    for (std::uint32_t i = 0; i < chunk.triangle_count; ++i) {
      const TriangleVertices a = vertices_of(part, chunk, chunk.first_triangle + i);
      const Vec3 n = normal(a);
      if (i + 1 < chunk.triangle_count) {
        const TriangleVertices b = vertices_of(part, chunk, chunk.first_triangle + i + 1);
        Vec3 corner, edge0, edge1;
        // pbrt-v3's density is that of a triangle.
        const bool alone = emission.picture || (emission.weighed && dialect == Dialect::v3);
        if (!alone && parallelogram(a.p, b.p, corner, edge0, edge1) && glm::dot(n, normal(b)) > 0.9999f) {
          if (auto made = make_flat(EmitterKind::parallelogram, corner, edge0, edge1, n, radiance(i), emission.two_sided)) {
            made->emitter.hide(emission);
            made->emitter.by_solid_angle &= chunk.alpha_texture == kNone && !emission.weighed;  // else pbrt's density shows
            slot(i) = slot(i + 1) = add(*made);
            ++i;
            continue;
          }
        }
      }
      if (auto made = make_flat(EmitterKind::triangle, a.p[0], a.p[1] - a.p[0], a.p[2] - a.p[0], n, radiance(i), emission.two_sided)) {
        made->emitter.hide(emission);
        if (emission.picture) {
          made->emitter.picture = static_cast<std::uint32_t>(pictures_.size());
          const float power = emission.power > 0.f ? power_factor(chunk.light, primitive(i)) : 1.f;
          const std::array<Vec2, 3> plain{Vec2(0, 0), Vec2(1, 0), Vec2(1, 1)};
          pictures_.push_back(make_picture(emission, power, a.p, a.has_uvs ? a.uv : plain));
        }
        slot(i) = add(*made);
      }
    }
  }

  std::vector<Emitter> emitters_;
  std::vector<EmitterBounds> bounds_;  // only while building
  std::vector<EmitterPoints> points_;  // likewise
  LightChoice choice_;
  LightRays rays_;
  std::vector<SpotCone> spots_;
  std::vector<DirectionalMap> maps_;
  std::vector<EmissiveQuadric> quadrics_;
  std::vector<InfiniteLight> infinite_;
  std::vector<std::uint32_t> infinite_emitters_;
  std::vector<Emission> emissions_;     // of each emissive shape
  std::vector<bool> is_mesh_;           // likewise
  std::vector<EmitterPicture> pictures_;
  std::vector<PrimitiveRange> ranges_;  // of each emissive shape
  std::vector<std::uint32_t> by_primitive_;
  std::vector<float> powers_;  // like by_primitive_; empty without a light that has a power
  bool wants_emission_ = false;
  bool emits_ = false;  // some shape shines, whether or not it can be sampled
};

}  // namespace

std::unique_ptr<Lights> Lights::build(const SceneDescription& scene,
                                      std::span<const AreaLightId> shape_lights,
                                      const Part& main_part, const Bounds3& bounds, Warnings& warnings) {
  return std::make_unique<SceneLights>(scene, shape_lights, main_part, bounds, warnings, true);
}

bool Lights::check(const SceneDescription& scene, Warnings& warnings) {
  return SceneLights(scene, {}, Part{}, {}, warnings, false).has_infinite();
}

}  // namespace cloudrenderer
