// make_fuzz_corpus FOLDER: writes the seeds of every fuzz target with the encoders of the program,
// and of each a copy that is cut off and one with flipped bits. The same bytes every time. Files of
// other names in the folder (findings) stay.
#include <zlib.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "net/handshake.h"
#include "parts/part_builder.h"
#include "scene/scene_codec.h"
#include "shading_rgl_support.h"
#include "tasks/checkpoint.h"
#include "wire_support.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;
using Block = std::vector<std::byte>;

class Corpus {
 public:
  explicit Corpus(fs::path folder) : folder_(std::move(folder)) {}

  void add(const std::string& target, const std::string& name, std::span<const std::byte> bytes) {
    write(target, name, bytes);
    if (bytes.size() < 4) return;
    write(target, name + "-cut", bytes.first(bytes.size() * 2 / 3));
    Block flipped(bytes.begin(), bytes.end());
    for (int i = 0; i < 3; ++i)
      flipped[dice_() % flipped.size()] ^= static_cast<std::byte>(1u << dice_() % 8);
    write(target, name + "-flipped", flipped);
  }
  void add(const std::string& target, const std::string& name, const std::string& text) {
    add(target, name, std::as_bytes(std::span(text)));
  }

 private:
  void write(const std::string& target, const std::string& name, std::span<const std::byte> bytes) {
    fs::create_directories(folder_ / target);
    std::ofstream out(folder_ / target / name, std::ios::binary);
    out.write(reinterpret_cast<const char*>(bytes.data()),
              static_cast<std::streamsize>(bytes.size()));
  }
  fs::path folder_;
  std::mt19937_64 dice_{1};
};

// A conversation, as fuzz::Pieces reads it.
class Conversation {
 public:
  Conversation& say(unsigned operation, std::span<const std::byte> bytes) {
    bytes_.push_back(static_cast<std::byte>(operation));
    bytes_.push_back(static_cast<std::byte>(bytes.size() & 0xff));
    bytes_.push_back(static_cast<std::byte>(bytes.size() >> 8));
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  Conversation& say(unsigned operation, const wire::Message& m) {
    return say(operation, std::span(*wire::encode(m)));
  }
  const Block& bytes() const { return bytes_; }

 private:
  Block bytes_;
};

wire::Hello hello(std::uint64_t incarnation, std::uint64_t memory = 10000) {
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_incarnation(incarnation);
  h.set_name("host");
  h.set_listen("127.0.0.1:4000");
  h.set_memory(memory);
  h.set_threads(2);
  for (int c = wire::LOADER; c <= wire::INTERSECTION; ++c)
    h.add_categories(static_cast<wire::Category>(c));
  h.add_features("triangles");
  h.set_path_credits(20000);
  return h;
}

wire::SceneHostMap scene_host_map(std::uint32_t epoch, std::uint32_t generation) {
  wire::SceneHostMap m;
  m.set_epoch(epoch);
  m.set_generation(generation);
  m.set_part_count(9);
  for (std::uint32_t host : {1u, 2u}) {
    m.add_hosts()->set_host(host);
    wire::Holding& h = *m.add_holdings();
    h.set_host(host);
    for (std::uint32_t p = 1; p <= 4; ++p) h.add_parts(4 * (host - 1) + p);
  }
  return m;
}

wire::Reply renderer_reply(wire::TaskUuid id, std::uint32_t task, std::size_t pixels) {
  wire::RendererReply r;
  r.task = task;
  r.sums.resize(pixels);
  for (PixelSums& p : r.sums)
    for (std::uint32_t s = 0; s < 4; ++s) p.add({static_cast<std::int64_t>(s) << 30, 2, -3}, s);
  return {id, 1, std::move(r)};
}

wire::Reply with_lobes(wire::Reply reply) {
  std::get<wire::RendererReply>(reply.payload).negative_lobes = true;
  return reply;
}

wire::Reply with_splats(wire::Reply reply) {
  std::get<wire::RendererReply>(reply.payload).splats = {{3, {{{7, -8, 9}, {0, 1, 2}}}}, {60, {}}};
  return reply;
}

std::vector<std::pair<std::string, wire::Message>> messages() {
  wire::Challenge challenge;
  challenge.set_nonce(std::string(32, 'n'));
  wire::PeerHello peer;
  peer.set_protocol(wire::kProtocolVersion);
  peer.set_host(2);
  wire::Welcome welcome;
  welcome.set_host(1);
  welcome.set_heartbeat_s(1);
  welcome.set_lost_after_s(3);
  wire::JobStart start;
  start.set_job(1);
  start.set_width(8);
  start.set_height(8);
  start.set_x1(8);
  start.set_y1(8);
  start.set_part_count(9);
  start.set_spp(4);
  (*start.mutable_options())["filter"] = "box";
  wire::LoadReport loaded;
  loaded.set_job(1);
  for (std::uint32_t p = 1; p < 4; ++p) loaded.add_loaded(p);
  wire::BlobRequest request;
  request.set_kind(wire::BLOB_FILE);
  request.set_name("sky.exr");
  request.set_bytes(4096);
  wire::BlobChunk chunk;
  chunk.set_total(3);
  chunk.set_data("abc");
  wire::Status status;
  status.set_load_s(0.5);
  status.add_unreachable(2);
  wire::TracerReply tracer;
  tracer.count = 3;
  tracer.accepted = {1};
  tracer.tested = {1, 2};
  wire::OcclusionReply occlusion;
  occlusion.count = 3;
  occlusion.blocked = {5};
  wire::SubmitTask nearest = wire::some_rays(3);
  std::get<wire::OcclusionBlock>(nearest.payload).nearest = true;
  wire::PathEnds ends;
  ends.generation = 1;
  ends.batch.ends.resize(3);
  wire::PathEnds lit = ends;
  lit.batch.ends[1].target = 9;
  lit.batch.ends[1].splat = {1 << 20, -2, 3};
  return {{"challenge", challenge},
          {"proof", wire::Proof()},
          {"hello", hello(7)},
          {"welcome", welcome},
          {"peer-hello", peer},
          {"map", scene_host_map(1, 1)},
          {"job-start", start},
          {"load-report", loaded},
          {"blob-request", request},
          {"blob-chunk", chunk},
          {"block", wire::some_block(3)},
          {"narrow-block", wire::some_block(2, 0)},
          {"rays", wire::some_rays(3)},
          {"range", wire::SubmitTask{{1, 2}, 1, 1, RendererRange{1, 0, 0, 8, 4, 0, 4}}},
          {"tracer-reply", wire::Reply{{1000, 1}, 1, tracer}},
          {"occlusion-reply", wire::Reply{{1000, 2}, 1, occlusion}},
          {"nearest-rays", nearest},
          {"lit-ends", lit},
          {"splats-reply", with_splats(renderer_reply({1000, 1}, 1, 32))},
          {"nearest-reply", wire::Reply{{1000, 3}, 1, wire::some_nearest(7)}},
          {"renderer-reply", renderer_reply({1, 2}, 1, 4)},
          {"renderer-reply-lobes", with_lobes(renderer_reply({1, 2}, 1, 4))},
          {"refusal", wire::Reply{{1000, 1}, 1, wire::Refusal{}}},
          {"path-ends", ends},
          {"status", status},
          {"leave", wire::Leave()}};
}

void add_wire(Corpus& corpus) {
  Conversation all;
  for (const auto& [name, message] : messages()) {
    corpus.add("wire_payload", name, std::span(*wire::encode(message)));
    all.say(2, message);
  }
  const auto frame = [](std::uint32_t sequence, std::uint32_t ack) {
    const auto head = wire::encode_frame_header({2, sequence, ack, 5}, 4);
    Block b(head.begin(), head.end());
    b.resize(b.size() + 4);
    return b;
  };
  Conversation link;
  link.say(128, frame(1, 0)).say(130, frame(3, 1));
  link.say(129, frame(2, 2)).say(130, frame(2, 2));
  link.say(131, frame(0xffffffff, 0xffffffff)).say(2, frame(1, 0));
  corpus.add("wire_link", "frames", std::span(link.bytes()));

  wire::Challenge challenge;
  challenge.set_nonce(std::string(32, 'n'));
  Conversation greeting;
  greeting.say(3, challenge).say(3, wire::Proof()).say(3, hello(7)).say(3, wire::Status());
  corpus.add("greeting", "joins", std::span(greeting.bytes()));
  corpus.add("greeting", "everything", std::span(all.bytes()));
  Conversation late;
  late.say(3, wire::Proof()).say(3, challenge).say(3, wire::Leave()).say(3, hello(7));
  corpus.add("greeting", "wrong-order", std::span(late.bytes()));
  Conversation http;
  const std::string get = "GET / HTTP/1.1\r\nHost: x\r\n\r\n";
  corpus.add("greeting", "http", std::span(http.say(0, std::as_bytes(std::span(get))).bytes()));
  Conversation tls;
  const std::string client_hello("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11);
  tls.say(0, std::as_bytes(std::span(client_hello)));
  corpus.add("greeting", "tls", std::span(tls.bytes()));
}

void add_cores(Corpus& corpus) {
  wire::LoadReport report;
  report.set_job(1);
  for (std::uint32_t p = 1; p < 4; ++p) report.add_loaded(p);
  wire::Status final;
  final.set_final(true);
  wire::Status unreachable;
  unreachable.add_unreachable(2);
  Conversation job;
  job.say(0, hello(1)).say(0, report).say(1, hello(2)).say(1, report);
  for (std::uint64_t task = 1; task < 4; ++task)
    job.say(0, renderer_reply({1, task}, static_cast<std::uint32_t>(task), 64));
  job.say(0, unreachable).say(129, wire::Leave()).say(128, final).say(1, std::span<std::byte>());
  corpus.add("manager_core", "job", std::span(job.bytes()));
  Conversation absurd;
  absurd.say(0, hello(1, std::uint64_t{1} << 60))
      .say(1, hello(2, ~std::uint64_t{0}))
      .say(2, hello(3, 0));
  absurd.say(0, report).say(1, report).say(130, unreachable);
  corpus.add("manager_core", "absurd", std::span(absurd.bytes()));

  Conversation worker, others;
  worker.say(2, wire::some_block(3)).say(2, wire::some_rays(3));
  worker.say(0, wire::SubmitTask{{5, 2}, 1, 1, RendererRange{2, 0, 4, 8, 8, 0, 4}});
  worker.say(0, scene_host_map(2, 1)).say(128, scene_host_map(3, 2)).say(0, wire::JobEnd());
  corpus.add("worker_core", "job", std::span(worker.bytes()));
  for (const auto& [name, message] : messages()) others.say(2, message);
  corpus.add("worker_core", "everything", std::span(others.bytes()));
}

constexpr const char* kScene = R"(# every directive
LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective" "float fov" [45]
Film "image" "integer xresolution" [16] "integer yresolution" 8 "string filename" "a.exr"
Sampler "lowdiscrepancy" "integer pixelsamples" [4]
SurfaceIntegrator "path" "integer maxdepth" [3]
PixelFilter "box"
WorldBegin
LightSource "point" "rgb I" [1 2 3] "point from" [0 1 2]
LightSource "infinite" "blackbody L" [6500 1]
Texture "t" "color" "checkerboard" "float uscale" 8 "rgb tex1" [.1 .2 .3]
MakeNamedMaterial "m" "string type" ["matte"] "texture Kd" "t"
AttributeBegin
  Translate 1 2 3 Rotate 90 0 0 1 Scale 1 -1 2
  CoordinateSystem "here"
  NamedMaterial "m"
  AreaLightSource "diffuse" "spectrum L" [400 1 700 1e0]
  Shape "trianglemesh" "point P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2] "float uv" [0 0 1 0 0 1]
AttributeEnd
ObjectBegin "o" Material "glass" Shape "sphere" "float radius" 1e+000 ObjectEnd
TransformBegin ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1] ObjectInstance "o" TransformEnd
Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]
CoordSysTransform "here" ReverseOrientation Identity
ActiveTransform StartTime Translate 0 0 1 ActiveTransform All
WorldEnd
)";
constexpr const char* kSceneV3 = R"(Integrator "bdpt" "integer maxdepth" 2
MakeNamedMedium "fog" "string type" "homogeneous" "rgb sigma_a" [0 0 0]
Camera "orthographic" "bool quiet" true
WorldBegin
MediumInterface "fog" ""
Material "uber" "rgb Kd" [.1,.2,.3] "float roughness" 0.01 "string escape" "a\n\"b\\"
Shape "plymesh" "string filename" "none.ply" "bool on" ["true" "false"]
Shape "loopsubdiv" "integer nlevels" 1 "integer indices" [0 1 2] "point P" [0 0 0 1 0 0 0 1 0]
Include "/proc/self/fd/none.pbrt"
)";

constexpr const char* kSceneV4 = R"(Film "rgb" "integer pixelbounds" [0 4 0 4] "float iso" 50
Option "bool disablepixeljitter" true
ColorSpace "rec2020"
WorldBegin
Attribute "shape" "float radius" 2
Attribute "light" "float scale" 2
AttributeBegin
Texture "t" "float" "directionmix" "vector dir" [0 1 0] "float tex1" 1
MakeNamedMaterial "a" "string type" "coateddiffuse" "rgb reflectance" [.1 .2 .3]
MakeNamedMaterial "b" "string type" [ "conductor" ] "spectrum eta" "metal-Au-eta" "texture roughness" "t"
Material "mix" "string materials" ["a" "b"] "float amount" .5
LightSource "spot" "blackbody I" 4500 "float power" 100
LightSource "infinite" "spectrum L" "stdillum-D65" "float illuminance" 5 "point3 portal" [0 0 0]
AreaLightSource "diffuse" "spectrum L" [400 1 700 2] "bool twosided" true
Shape "sphere"
AttributeEnd
NamedMaterial "b"
Import "none.pbrt"
)";

void add_text(Corpus& corpus) {
  corpus.add("scene", "all", kScene);
  corpus.add("scene", "v3", kSceneV3);
  corpus.add("scene", "v4", kSceneV4);
  corpus.add("scene", "nested",
             "WorldBegin " + std::string(200, '[') + " ObjectBegin \"a\" ObjectBegin \"b\"");
  corpus.add("lexer", "all", kScene);
  corpus.add("lexer", "numbers",
             "[1 -2.5 .5 5. 1e10 1e+006 -1E-400 1e999 0x1p3 2147483648 -0 ] [1 2.9 -3 4,5] [inf "
             "nan] [\"a\" [1] # x\n]");
  corpus.add("lexer", "strings", "\"a\\n\\\"b\\\\\" \"\" \"\\101\" # comment\r\n Word, [ \"open");
  corpus.add("address", "name", "host.example:4000");
  corpus.add("address", "v6", "[fe80::1]:65535");
  corpus.add("address", "v4", "127.0.0.1:0");
  corpus.add("measured", "two", "# wavelengths\n2\n400 700\n0.5 0 0.5 3.14 0.1 0.2\n1 0 0 0 1 2\n");
  corpus.add("measured", "odd", "1 500 9e8 -1 1e-30 nan -5\n 0 0 0 0 -5 7 0 7 0 1\n");
  corpus.add("spd", "lines", "# lambda value\n400 0.5\n550.5,1\n700 1e-3 # end\n");
  corpus.add("spd", "odd", "700 1\n400 -1\n400 nan\n");
}

std::string gzipped(const std::string& text) {
  z_stream z{};
  if (deflateInit2(&z, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    throw std::runtime_error("zlib");
  std::string in = text, out(text.size() + 100, '\0');
  z.next_in = reinterpret_cast<Bytef*>(in.data());
  z.avail_in = static_cast<uInt>(in.size());
  z.next_out = reinterpret_cast<Bytef*>(out.data());
  z.avail_out = static_cast<uInt>(out.size());
  deflate(&z, Z_FINISH);
  out.resize(z.total_out);
  deflateEnd(&z);
  return out;
}

void add_ply(Corpus& corpus) {
  const std::string properties =
      "property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n"
      "property float nz\nproperty float u\nproperty float v\n";
  const auto header = [&](const std::string& format) {
    return "ply\nformat " + format + " 1.0\ncomment c\nelement vertex 4\n" + properties +
           "element face 2\nproperty list uchar int vertex_indices\nproperty uchar "
           "flags\nend_header\n";
  };
  std::string text = header("ascii");
  for (const char* v : {"0 0 0", "1 0 0", "1 1 0", "0 1 1e-1"})
    text += std::string(v) + " 0 0 1 .5 .5\n";
  text += "4 0 1 2 3 7\n3 0 1 2 0\n";
  corpus.add("ply", "ascii", text);
  corpus.add("ply", "gzip", gzipped(text));
  for (const bool little : {true, false}) {
    std::ostringstream out;
    out << header(little ? "binary_little_endian" : "binary_big_endian");
    const auto put32 = [&](std::uint32_t v) {
      for (int i = 0; i < 4; ++i) out.put(static_cast<char>(v >> (little ? 8 * i : 24 - 8 * i)));
    };
    for (std::uint32_t i = 0; i < 32; ++i) put32(0x3f800000 + i);
    for (const std::uint32_t corners : {4u, 3u}) {
      out.put(static_cast<char>(corners));
      for (std::uint32_t i = 0; i < corners; ++i) put32(i);
      out.put('\1');
    }
    corpus.add("ply", little ? "little" : "big", out.str());
  }
  std::string absurd = header("binary_little_endian");
  absurd.replace(absurd.find("vertex 4"), 8, "vertex 999999999999999");
  corpus.add("ply", "absurd-count", absurd);
}

SceneDescription a_scene() {
  SceneDescription s;
  s.source = "a.pbrt";
  s.camera.type = "perspective";
  s.materials.resize(2);
  s.materials[1].type = "matte";
  s.textures.resize(1);
  s.lights.resize(1);
  s.area_lights.resize(2);
  return s;
}

void add_parts(Corpus& corpus) {
  PartBuilder b;
  const std::vector<Vec3> p = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0.5f}};
  const std::vector<Vec3> n(4, Vec3(0, 0, 1));
  const std::vector<Vec2> uv = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
  const std::vector<Triangle> t = {{0, 1, 2}, {2, 1, 3}};
  const std::vector<std::uint32_t> gaps = {3, 9};
  MeshChunk c;
  c.material = 1;
  b.add_chunk(c, {p, n, uv, t, gaps});
  c.shape = 1;
  b.add_chunk(c, {p, {}, {}, t, {}});
  b.add_quadric({});
  b.add_instance({Transform(), 0, 9});
  const std::string file = (fs::temp_directory_path() / "make-fuzz-corpus.part").string();
  b.write(file);
  std::ifstream in(file, std::ios::binary);
  const std::string part{std::istreambuf_iterator<char>(in), {}};
  fs::remove(file);
  corpus.add("part_file", "all", part);
  PartBuilder moving;
  MotionRecord motion{Mat4(1.f), Mat4(1.f), 0, 1, 0, AnimatedTransform::Interpolates::inverse};
  motion.end[3] = {1, 2, 3, 1};
  moving.add_instance({Transform(), 0, 9}, std::span(&motion, 1));
  moving.write(file);
  std::ifstream moving_in(file, std::ios::binary);
  corpus.add("part_file", "moving", {std::istreambuf_iterator<char>(moving_in), {}});
  fs::remove(file);

  Manifest m;
  m.scene = a_scene();
  m.prototypes.push_back({"tree", {Vec3(0), Vec3(1)}, 100, 200, 300, 4});
  m.parts.push_back({});
  m.parts.push_back({{{Vec3(-1), Vec3(1)}, {Vec3(2), Vec3(3)}}, 5, 6, 7, {0}});
  m.shape_lights = {AreaLightId(1), AreaLightId(0)};
  m.bounds = {Vec3(-2), Vec3(5)};
  corpus.add("manifest", "all", encode(m));
  corpus.add("scene_codec", "small", encode(m.scene));

  struct Nothing final : SceneSink {
    void begin_object(ObjectId, const std::string&) override {}
    void end_object(ObjectId) override {}
    void shape(ShapeDesc&&, const SceneDescription&) override {}
    void instance(const InstanceDesc&, const SceneDescription&) override {}
  } nothing;
  const std::string path = (fs::temp_directory_path() / "make-fuzz-corpus.pbrt").string();
  std::ofstream(path) << kScene;
  Warnings warnings;
  SceneDescription scene = parse_scene(path, {}, nothing, warnings);
  fs::remove(path);
  scene.source = "a.pbrt";  // no folder of this machine
  corpus.add("scene_codec", "all", encode(scene));
}

void add_checkpoint(Corpus& corpus) {
  CheckpointJob job;
  job.split = 1;
  job.frame = {20, 12, 1, 2, 14, 12};
  job.k = 30;
  job.tile = 8;
  Bytes bytes = encode_header(job);
  const std::uint64_t sum = header_checksum(bytes);
  corpus.add("checkpoint", "header", std::span<const std::byte>(bytes));
  for (std::uint32_t i = 0; i < 2; ++i) {
    TileSums tile{1 + 8 * i, 2, i == 0 ? 9u : 14u, 10, {{i, 4}, {6, 7}}, 1, 2, i == 0, {}};
    tile.sums.resize(std::size_t{tile.x1 - tile.x0} * 8);
    if (i == 0)
      for (PixelSums& p : tile.sums)
        for (const std::uint32_t s : {0u, 1u, 2u, 3u, 6u}) p.add({5, -6, 7}, s);
    encode_record(tile, sum, bytes);
  }
  corpus.add("checkpoint", "records", std::span<const std::byte>(bytes));
}

void add_tables(Corpus& corpus) {
  using testing::RglFormula;
  corpus.add("rgl", "spectra", RglFormula{.thetas = 2, .fine = 3, .coarse = 2, .wavelengths = {400, 600}}.bytes());
  corpus.add("rgl", "rgb", RglFormula{.alpha_x = 0.1, .thetas = 1, .phis = 3, .folds = 4, .fine = 3, .coarse = 2, .rgb = true}.bytes());
}

}  // namespace
}  // namespace cloudrenderer

int main(int argc, char** argv) {
  using namespace cloudrenderer;
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s FOLDER\n", argv[0]);
    return 2;
  }
  Corpus corpus(argv[1]);
  add_wire(corpus);
  add_cores(corpus);
  add_text(corpus);
  add_ply(corpus);
  add_parts(corpus);
  add_checkpoint(corpus);
  add_tables(corpus);
  return 0;
}
