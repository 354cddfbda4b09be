// The recorded frames of tools/conformance/frames, with their meaning in JSON, are what this codec makes and reads. After a
// change of the format: CLOUDRENDERER_RECORD=1 build/release/tests/wire_tests --gtest_filter='Conformance.*' writes them anew.
#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "wire/bulk_codec.h"
#include "wire_support.h"

namespace cloudrenderer::wire {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

fs::path folder() { return fs::path(CLOUDRENDERER_SOURCE_DIR) / "tools" / "conformance" / "frames"; }

std::string file_text(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Gives every field a value of its own: what follows from its number.
void fill(google::protobuf::Message& m) {
  using Field = google::protobuf::FieldDescriptor;
  const auto* r = m.GetReflection();
  for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) {
    const Field* f = m.GetDescriptor()->field(i);
    if (f->is_map()) continue;
    const auto n = static_cast<std::uint32_t>(f->number());
    const std::string text = f->name().substr(0, 4) + std::to_string(n);
    const bool many = f->is_repeated();
    for (int k = 0; k < (many ? 2 : 1); ++k) {
      switch (f->cpp_type()) {
        case Field::CPPTYPE_UINT32: many ? r->AddUInt32(&m, f, n + static_cast<std::uint32_t>(k)) : r->SetUInt32(&m, f, n); break;
        case Field::CPPTYPE_UINT64: many ? r->AddUInt64(&m, f, n << 20) : r->SetUInt64(&m, f, std::uint64_t{n} << 33); break;
        case Field::CPPTYPE_INT32: r->SetInt32(&m, f, -static_cast<int>(n)); break;
        case Field::CPPTYPE_FLOAT: r->AddFloat(&m, f, static_cast<float>(n) + 0.25f * static_cast<float>(k)); break;
        case Field::CPPTYPE_DOUBLE: r->SetDouble(&m, f, n + 0.25); break;
        case Field::CPPTYPE_BOOL: r->SetBool(&m, f, true); break;
        case Field::CPPTYPE_ENUM: many ? r->AddEnumValue(&m, f, 4 + k) : r->SetEnumValue(&m, f, 1); break;
        case Field::CPPTYPE_STRING: many ? r->AddString(&m, f, text + std::to_string(k)) : r->SetString(&m, f, text); break;
        case Field::CPPTYPE_MESSAGE: fill(many ? *r->AddMessage(&m, f) : *r->MutableMessage(&m, f)); break;
        default: FAIL() << f->name();
      }
    }
  }
}

template <class M>
M filled() {
  M m;
  fill(m);
  return m;
}

Json number(float v) { return std::isinf(v) ? Json("inf") : Json(v); }
Json number(std::uint64_t v) { return v; }
Json number(std::uint32_t v) { return v; }
Json number(std::uint16_t v) { return v; }
Json number(std::int64_t v) { return v; }
Json number(const Vec3& v) { return {number(v.x), number(v.y), number(v.z)}; }
Json number(const Vec2& v) { return {number(v.x), number(v.y)}; }
Json number(const Int128& v) { return static_cast<std::int64_t>(v); }  // those that stand here are small
template <class T, std::size_t n>
Json number(const std::array<T, n>& v) {
  Json list = Json::array();
  for (const T& x : v) list.push_back(number(x));
  return list;
}

// One column; `of` gives its entry of a record.
template <class Records, class F>
void column(Json& out, const char* name, const Records& records, F of) {
  Json values = Json::array();
  for (const auto& r : records) values.push_back(number(of(r)));
  out.push_back({{"name", name}, {"values", values}});
}
constexpr auto kItself = [](const auto& v) { return v; };

Json columns(const SubmitTask& m) {
  Json out = Json::array();
  if (const auto* rays = std::get_if<OcclusionBlock>(&m.payload)) {
    using R = OcclusionRay;
    column(out, "rays", *rays->chunks[0], [](const R& r) {
      return std::array<float, 7>{r.origin.x, r.origin.y, r.origin.z, r.direction.x, r.direction.y, r.direction.z, r.t_max};
    });
    if (!rays->times.empty()) column(out, "times", *rays->times[0], kItself);
  }
  const auto* block = std::get_if<SegmentBlock>(&m.payload);
  if (!block) return out;
  const auto& all = *block->chunks[0];
  using S = PathSegment;
  const auto has = [&](Column c) { return (block->columns & c) != 0; };
  column(out, "origin", all, [](const S& s) { return s.origin; });
  column(out, "direction", all, [](const S& s) { return s.direction; });
  column(out, "throughput", all, [](const S& s) { return s.throughput; });
  column(out, "previous_pdf", all, [](const S& s) { return s.previous_pdf; });
  column(out, "radiance", all, [](const S& s) { return s.radiance; });
  if (has(kColumnPreviousNormal)) column(out, "previous_normal", all, [](const S& s) { return s.previous_normal; });
  if (has(kColumnBestHit)) {
    Json values = Json::array();
    for (const S& s : all) values.push_back({number(s.best.t), s.best.shape, s.best.primitive});
    out.push_back({{"name", "best_hit"}, {"values", values}});
  }
  if (has(kColumnTested)) {
    column(out, "tested", all, [](const S& s) { return s.tested; });
    column(out, "window", all, [](const S& s) { return s.window; });
  }
  column(out, "task", all, [](const S& s) { return s.task; });
  column(out, "pixel", all, [](const S& s) { return s.pixel; });
  column(out, "sample", all, [](const S& s) { return s.sample; });
  column(out, "owner", all, [](const S& s) { return s.owner; });
  column(out, "vertex", all, [](const S& s) { return s.vertex; });
  column(out, "flags", all, [](const S& s) { return s.flags; });
  column(out, "passed", all, [](const S& s) { return s.passed; });
  if (has(kColumnCone)) column(out, "cone", all, [](const S& s) { return Vec2(s.cone_width, s.cone_spread); });
  if (has(kColumnMedium)) column(out, "medium", all, [](const S& s) { return s.medium; });
  return out;
}

Json columns(const Reply& m) {
  Json out = Json::array();
  if (const auto* r = std::get_if<TracerReply>(&m.payload)) {
    column(out, "accepted", r->accepted, kItself);
    column(out, "tested", r->tested, kItself);
    if (!r->windows.empty()) column(out, "windows", r->windows, kItself);
  } else if (const auto* o = std::get_if<OcclusionReply>(&m.payload)) {
    column(out, "blocked", o->blocked, kItself);
  } else if (const auto* p = std::get_if<RendererReply>(&m.payload)) {
    column(out, "counts", p->sums, [](const PixelSums& s) { return s.count; });
    column(out, "sums", p->sums, [](const PixelSums& s) { return s.sum; });
    if (p->splats.empty()) return out;
    column(out, "splats pixel", p->splats, [](const Splat& s) { return s.pixel; });
    column(out, "splats sums", p->splats, [](const Splat& s) { return s.sum; });
  } else if (const auto* n = std::get_if<NearestReply>(&m.payload)) {
    using H = AnsweredHit;
    const ReplyControl c = control_of(m);
    column(out, "found", n->found, kItself);
    column(out, "t", n->hits, [](const H& h) { return h.t; });
    column(out, "uv", n->hits, [](const H& h) { return Vec2(h.u, h.v); });
    column(out, "shape", n->hits, [](const H& h) { return h.shape; });
    column(out, "primitive", n->hits, [](const H& h) { return h.primitive; });
    column(out, "corners", n->hits, [](const H& h) { return h.surface.p; });
    if (c.normals()) column(out, "normals", n->hits, [](const H& h) { return h.surface.n; });
    if (c.uvs()) column(out, "uvs", n->hits, [](const H& h) { return h.surface.uv; });
    column(out, "material", n->hits, [](const H& h) { return h.surface.material; });
    column(out, "light", n->hits, [](const H& h) { return h.surface.light; });
    column(out, "flags", n->hits, [](const H& h) { return h.surface.flags; });
  }
  return out;
}

void feature_columns(Json& out, const std::vector<PathFeatures>& all) {
  column(out, "features task", all, [](const PathFeatures& f) { return f.task; });
  column(out, "features pixel", all, [](const PathFeatures& f) { return f.pixel; });
  column(out, "features sample", all, [](const PathFeatures& f) { return f.sample; });
  column(out, "features owner", all, [](const PathFeatures& f) { return f.owner; });
  column(out, "features flags", all, [](const PathFeatures& f) { return f.flags; });
  column(out, "features ids", all, [](const PathFeatures& f) { return f.ids; });
  column(out, "features values", all, [](const PathFeatures& f) { return f.values; });
}

Json columns(const PathEnds& m) {
  Json out = Json::array();
  column(out, "task", m.batch.ends, [](const PathEnd& e) { return e.task; });
  column(out, "pixel", m.batch.ends, [](const PathEnd& e) { return e.pixel; });
  column(out, "sample", m.batch.ends, [](const PathEnd& e) { return e.sample; });
  column(out, "owner", m.batch.ends, [](const PathEnd& e) { return e.owner; });
  column(out, "flags", m.batch.ends, [](const PathEnd& e) { return e.flags; });
  column(out, "radiance", m.batch.ends, [](const PathEnd& e) { return e.radiance; });
  std::vector<std::uint32_t> splats;  // of which ends
  for (std::uint32_t i = 0; i < m.batch.ends.size(); ++i)
    if (m.batch.ends[i].target != PathEnd().target) splats.push_back(i);
  if (!m.batch.features.empty()) feature_columns(out, m.batch.features);
  if (splats.empty()) return out;
  column(out, "splats end", splats, kItself);
  column(out, "splats target", splats, [&](std::uint32_t i) { return m.batch.ends[i].target; });
  column(out, "splats light", splats, [&](std::uint32_t i) { return m.batch.ends[i].splat; });
  return out;
}

// Protobuf's own JSON: 64-bit numbers are strings there, bytes base64.
Json control_json(const google::protobuf::Message& m) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  std::string text;
  EXPECT_TRUE(google::protobuf::util::MessageToJsonString(m, &text, options).ok());
  return Json::parse(text);
}

Json meaning(const Message& message) {
  return std::visit(
      [](const auto& m) -> Json {
        if constexpr (requires { control_of(m); })
          return {{"control", control_json(control_of(m))}, {"columns", columns(m)}};
        else
          return {{"control", control_json(m)}, {"columns", Json::array()}};
      },
      message);
}

std::vector<std::pair<std::string, Message>> messages() {
  std::vector<std::pair<std::string, Message>> all;
  const auto add = [&](const std::string& name, Message m) { all.emplace_back(name, std::move(m)); };
  Challenge challenge;
  challenge.set_nonce("0123456789abcdef0123456789abcdef");
  add("challenge", challenge);
  Proof proof;  // HMAC-SHA256, key "a secret", of "connects" and the nonce above: checked by check_frames.py
  proof.set_code(std::string("\xd1\x88\x4b\xe3\x89\xbe\x1f\x13\xb7\x4b\x86\xcf\x0f\x40\x29\x34"
                             "\x0d\x0a\x88\xd2\x0d\x74\x71\x11\xdf\x11\x29\x4f\xd6\x14\xdc\x01", 32));
  add("proof", proof);
  add("hello", filled<Hello>());
  add("welcome", filled<Welcome>());
  add("refused", filled<Refused>());
  add("peer_hello", filled<PeerHello>());
  HostList list;
  *list.add_hosts() = filled<HostEntry>();
  *list.add_hosts() = filled<HostEntry>();
  add("host_list", list);
  auto map = filled<SceneHostMap>();
  map.set_part_count(9);
  map.clear_since();
  map.clear_gone();
  add("scene_host_map", map);
  auto start = filled<JobStart>();
  start.set_width(60);
  start.set_height(50);
  start.set_light_paths(2);
  (*start.mutable_options())["max_depth"] = "7";
  add("job_start", start);
  add("job_end", filled<JobEnd>());
  add("cancel_job", filled<CancelJob>());
  add("load_parts", filled<LoadParts>());
  add("unload_parts", filled<UnloadParts>());
  add("load_report", filled<LoadReport>());
  add("blob_request", filled<BlobRequest>());
  auto chunk = filled<BlobChunk>();
  chunk.set_offset(4);
  chunk.set_total(100);
  chunk.clear_error();
  add("blob_chunk", chunk);
  add("submit_renderer", SubmitTask{{77, 1}, 3, 2, RendererRange{9, 1, 2, 33, 34, 5, 21}});
  add("submit_tracer", some_block(5));
  add("submit_tracer_few_columns", some_block(3, 0));
  add("submit_intersection", some_rays(4));
  SubmitTask timed = some_rays(3);
  std::get<OcclusionBlock>(timed.payload).times = {std::make_shared<const std::vector<float>>(std::vector<float>{0, 0.5f, 1})};
  add("submit_intersection_times", timed);
  SubmitTask nearest = some_rays(70);
  std::get<OcclusionBlock>(nearest.payload).nearest = true;
  add("submit_nearest", nearest);
  add("reply_refused", Reply{{77, 2}, 3, Refusal{}});
  add("reply_tracer", Reply{{77, 2}, 3, TracerReply{{0b10110}, {3, 1u << 20}, {0, 2}, 5}});
  add("reply_intersection", Reply{{77, 3}, 3, OcclusionReply{{0b1010}, 4}});
  add("reply_nearest", Reply{{77, 4}, 3, some_nearest(kAnsweredFlip | kAnsweredNormals | kAnsweredUvs)});
  add("reply_nearest_bare", Reply{{77, 4}, 3, some_nearest(0)});
  RendererReply sums;
  sums.task = 9;
  sums.sums.resize(2);
  sums.sums[0].add({5, -70000, 1}, 0);
  sums.sums[1].add({1 << 20, 2, 3}, 1);
  sums.invalid = 30;
  add("reply_renderer", Reply{{77, 1}, 3, sums});
  sums.negative_lobes = true;  // one pixel
  add("reply_renderer_lobes", Reply{{77, 1}, 3, sums});
  sums.negative_lobes = false;
  sums.splats = {{5, {{{7, -8, 9}, {0, 1, 1 << 20}}}}, {70000, {{{1, 2, 3}, {4, 5, 6}}}}};
  add("reply_renderer_splats", Reply{{77, 1}, 3, sums});
  PathEnds ends;
  ends.generation = 2;
  for (std::uint32_t i = 0; i < 3; ++i)
    ends.batch.ends.push_back({9, i, 5, 1, static_cast<std::uint16_t>(i), {i * 1000, -5, 1 << 18}});
  add("path_ends", ends);
  PathEnds lit = ends;
  lit.batch.ends[0].target = 70000;
  lit.batch.ends[2].target = 5;
  lit.batch.ends[2].splat = {1 << 20, -2, 3};
  add("path_ends_splats", lit);
  for (std::uint32_t i = 0; i < 2; ++i)
    ends.batch.features.push_back({9, i, 5, 1, kTellsHit | kTellsSurface, {1, 2, 3}, {1 << 29, 5, -6, 7, 8, 9, 10, -11, 12, std::int64_t{1} << 33}});
  add("path_ends_features", ends);
  add("status", filled<Status>());
  add("leave", filled<Leave>());
  add("error", filled<Error>());
  add("cancel_task", filled<CancelTask>());
  auto changes = filled<HostList>();
  changes.clear_hosts();
  add("host_list_changes", changes);
  auto change = filled<SceneHostMap>();
  change.set_part_count(9);
  change.set_epoch(10);
  add("scene_host_map_change", change);
  add("pool_welcome", filled<PoolWelcome>());
  add("pool_orders", filled<PoolOrders>());
  add("pool_status", filled<PoolStatus>());
  return all;
}

TEST(Conformance, RecordedFramesAreWhatTheCodecMakes) {
  const bool record = std::getenv("CLOUDRENDERER_RECORD") != nullptr;
  Json made = Json::array();
  std::vector<bool> seen(std::variant_size_v<Message>);
  std::uint32_t sequence = 0;
  for (const auto& [name, message] : messages()) {
    const auto decoded = decode(*encode(message));
    ASSERT_TRUE(decoded) << name << ": " << decoded.error();
    EXPECT_EQ(meaning(*decoded), meaning(message)) << name;
    const std::size_t type = message.index();
    seen[type] = true;
    const bool handshake = type <= 5 || std::holds_alternative<PoolWelcome>(message);
    const LinkHeader link = handshake ? LinkHeader{} : LinkHeader{0x1234567, ++sequence, 3, 5};
    const Bytes payload = encode(message);
    const auto header = encode_frame_header(link, payload->size());
    std::string bytes(reinterpret_cast<const char*>(header.data()), header.size());
    bytes.append(reinterpret_cast<const char*>(payload->data()), payload->size());
    Json entry{{"file", name + ".bin"}, {"type", type}, {"message", message_name(message)},
               {"link", {{"incarnation", link.incarnation}, {"sequence", link.sequence}, {"ack", link.ack}, {"window", link.window}}}};
    entry.update(meaning(message));
    made.push_back(std::move(entry));
    if (record)
      std::ofstream(folder() / (name + ".bin"), std::ios::binary) << bytes;
    else
      EXPECT_TRUE(file_text(folder() / (name + ".bin")) == bytes) << name << ".bin is not what the codec makes now";
  }
  for (std::size_t type = 0; type < seen.size(); ++type) EXPECT_TRUE(seen[type]) << "no frame of type " << type;
  if (record) {
    std::ofstream out(folder() / "frames.json");
    out << "[\n";
    for (std::size_t i = 0; i < made.size(); ++i) out << made[i].dump() << (i + 1 < made.size() ? ",\n" : "\n");
    out << "]\n";
  } else {
    // Not EXPECT_EQ, which would print both.
    EXPECT_TRUE(Json::parse(file_text(folder() / "frames.json")) == made) << "frames.json is not what the frames mean";
  }
}

}  // namespace
}  // namespace cloudrenderer::wire
