#include "parts/text.h"

#include <spdlog/fmt/fmt.h>

#include <cerrno>
#include <fstream>
#include <stdexcept>
#include <system_error>

#include "parts/split.h"
#include "scene/scene_text.h"

namespace cloudrenderer {
namespace {

// A text file that is checked when it is done.
class TextFile {
 public:
  explicit TextFile(std::string path) : path_(std::move(path)), out_(path_, std::ios::binary) {}
  std::ostream& out() { return out_; }
  void close() {
    out_.close();
    if (!out_) throw std::system_error(errno, std::generic_category(), path_);
  }

 private:
  std::string path_;
  std::ofstream out_;
};

class PartText {
 public:
  PartText(std::ostream& out, const Manifest& manifest) : out_(out), manifest_(manifest) {}

  void write(const Part& part) {
    for (const MeshChunk& c : part.chunks) mesh(part, c);
    for (const QuadricRecord& q : part.quadrics) quadric(q);
    curves(part.curves);
    for (std::uint32_t n = 0; n < part.instances.size(); ++n) {
      const InstanceRecord& i = part.instances[n];
      out_ << "AttributeBegin\n";
      place(i, motions_of(part.motions, n));
      out_ << "ObjectInstance \"p" << i.prototype << "\"\nAttributeEnd\n";
    }
  }

 private:
  // The text of one movement in another is that of both ends: pbrt interpolates between them, we move by both.
  void place(const InstanceRecord& i, std::span<const MotionRecord> motions) {
    if (motions.empty()) return write_transform(out_, i.to_world);
    Mat4 start = i.to_world.matrix(), end = start;
    for (const MotionRecord& m : motions) {
      start = start * m.start;
      end = end * m.end;
    }
    if (motions.size() > 1 || !i.to_world.is_identity())
      out_ << "# a movement in a movement: the ends are right, what is between them nearly\n";
    write_motion(out_, Transform(start), Transform(end));
  }
  void begin_shape(std::uint32_t material, std::uint32_t light, bool reverse) {
    const SceneDescription& scene = manifest_.scene;
    out_ << "AttributeBegin\n";
    write_material_use(out_, scene, MaterialId(material));
    if (light != kNone) write_area_light(out_, scene, manifest_.shape_lights.at(light));
    if (reverse) out_ << "ReverseOrientation\n";
  }

  template <class T>
  void array(const char* name, std::span<const T> values, float sign = 1.f) {
    out_ << "  \"" << name << "\" [\n";
    for (const T& v : values) {
      for (int i = 0; i < T::length(); ++i) {
        write_float(out_, sign * v[i]);
        out_ << (i + 1 < T::length() ? ' ' : '\n');
      }
    }
    out_ << "  ]\n";
  }

  void texture(const char* parameter, std::uint32_t index) {
    if (index == kNone) return;
    out_ << "  \"texture " << parameter << "\" ";
    write_quoted(out_, manifest_.scene.textures.at(index).name);
    out_ << '\n';
  }

  void mesh(const Part& part, const MeshChunk& c) {
    // Vertices are in world space already, so that nothing but ReverseOrientation turns a normal.
    // It turns those of the vertices as well, which have been turned.
    begin_shape(c.material, c.light, c.flip != 0);
    out_ << "Shape \"trianglemesh\"\n  \"integer indices\" [\n";
    for (const Triangle& t : part.triangles.subspan(c.first_triangle, c.triangle_count)) {
      const Triangle local = t - c.first_vertex;
      out_ << local.x << ' ' << local.y << ' ' << local.z << '\n';
    }
    out_ << "  ]\n";
    array("point P", part.positions.subspan(c.first_vertex, c.vertex_count));
    if (c.first_normal != kNone)
      array("normal N", part.normals.subspan(c.first_normal, c.vertex_count), c.flip ? -1.f : 1.f);
    if (c.first_uv != kNone) array("float uv", part.uvs.subspan(c.first_uv, c.vertex_count));
    texture("alpha", c.alpha_texture);
    texture("shadowalpha", c.shadow_alpha_texture);
    out_ << "AttributeEnd\n";
  }

  void real(const char* name, float value) {
    out_ << "  \"float " << name << "\" [ ";
    write_float(out_, value);
    out_ << " ]\n";
  }
  void point(const char* name, const Vec3& p) {
    out_ << "  \"point " << name << "\" [";
    for (int i = 0; i < 3; ++i) {
      out_ << ' ';
      write_float(out_, p[i]);
    }
    out_ << " ]\n";
  }

  void quadric(const QuadricRecord& record) {
    const Quadric& q = record.quadric;
    const bool mirrored = q.object_to_world.swaps_handedness();
    // pbrt-v2 sees a disk from its other side, pbrt-v3 a mirrored quadric (see make_disk).
    const bool inside_out =
        (mirrored && manifest_.scene.dialect == Dialect::v3) ||
        (manifest_.scene.dialect == Dialect::v2 && q.kind == QuadricKind::disk);
    begin_shape(record.material, record.light,
                (record.flip != 0) != mirrored ? inside_out == (q.inside_out != 0)
                                               : inside_out != (q.inside_out != 0));
    write_transform(out_, q.object_to_world);
    const auto shape = [&](const char* type) { out_ << "Shape \"" << type << "\"\n"; };
    switch (q.kind) {
      case QuadricKind::sphere:
        shape("sphere");
        real("radius", q.radius);
        z_range(q);
        break;
      case QuadricKind::cylinder:
        shape("cylinder");
        real("radius", q.radius);
        z_range(q);
        break;
      case QuadricKind::disk:
        shape("disk");
        real("radius", q.radius);
        real("innerradius", q.inner_radius);
        real("height", q.height);
        break;
      case QuadricKind::cone:
        shape("cone");
        real("radius", q.radius);
        real("height", q.height);
        break;
      case QuadricKind::paraboloid:
        shape("paraboloid");
        real("radius", q.radius);
        z_range(q);
        break;
      case QuadricKind::hyperboloid:
        shape("hyperboloid");
        point("p1", q.p1);
        point("p2", q.p2);
        break;
    }
    if (q.phi_max < 2 * kPi) real("phimax", q.phi_max * (180.f / kPi));
    texture("alpha", record.alpha_texture);
    out_ << "AttributeEnd\n";
  }
  // Segments of a piece that follow each other as one curve.
  void curves(const CurveArrays& all) {
    for (std::uint32_t i = 0, end = 0; i < all.segments.size(); i = end) {
      for (end = i + 1; end < all.segments.size() && all.segments[end] == all.segments[end - 1] + 1 &&
                        &all.record_of(end) == &all.record_of(i);)
        ++end;
      const CurveRecord& record = all.record_of(i);
      const CurveGroup& group = all.groups[record.group];
      const CurvePiece piece = part_of(all.piece(record), all.range(i)[0], all.range(end - 1)[1]);
      begin_shape(group.material, group.light, (group.flip != 0) != group.object_to_world.swaps_handedness());
      if (group.placed) write_transform(out_, group.object_to_world);
      const char* const names[] = {"flat", "cylinder", "ribbon"};
      out_ << "Shape \"curve\"\n  \"string type\" [ \"" << names[group.kind] << "\" ]\n";
      array<Vec3>("point P", piece.p);
      real("width0", piece.width[0]);
      real("width1", piece.width[1]);
      if (piece.kind == CurveKind::ribbon) array<Vec3>("normal N", piece.n);
      texture("alpha", group.alpha_texture);
      texture("shadowalpha", group.shadow_alpha_texture);
      out_ << "AttributeEnd\n";
    }
  }
  void z_range(const Quadric& q) {
    real("zmin", q.z_min);
    real("zmax", q.z_max);
  }

  std::ostream& out_;
  const Manifest& manifest_;
};

Part read_written(const std::string& path) {
  Result<Part> part = read_part_file(path);
  if (!part) throw std::runtime_error(part.error());
  return std::move(*part);
}

}  // namespace

void write_text(const std::string& folder, const Manifest& manifest) {
  TextFile main(folder + "/main.pbrt");
  write_options(main.out(), manifest.scene);
  write_world_head(main.out(), manifest.scene);
  for (std::uint32_t p = 0; p < manifest.prototypes.size(); ++p) {
    const std::string name = fmt::format("prototypes/{:05}.pbrt", p);
    main.out() << "ObjectBegin \"p" << p << "\"\nInclude \"" << name << "\"\nObjectEnd\n";
    TextFile file(folder + "/" + name);
    PartText(file.out(), manifest).write(read_written(prototype_path(folder, p)));
    file.close();
  }
  PartText(main.out(), manifest).write(read_written(part_path(folder, 0)));
  for (std::uint32_t p = 1; p < manifest.parts.size(); ++p) {
    const std::string name = fmt::format("parts/{:05}.pbrt", p);
    main.out() << "Include \"" << name << "\"\n";
    TextFile file(folder + "/" + name);
    PartText(file.out(), manifest).write(read_written(part_path(folder, p)));
    file.close();
  }
  main.out() << "WorldEnd\n";
  main.close();
}

}  // namespace cloudrenderer
