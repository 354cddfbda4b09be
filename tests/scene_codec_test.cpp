#include "scene/scene_codec.h"

#include <gtest/gtest.h>

#include <bit>
#include <functional>
#include <random>

#include "scene/scene.pb.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

SceneDescription sample() {
  return parse_text(R"(
Rotate 30 1 2 3 Translate 1 2 .1
MakeNamedMedium "fog" "string type" "homogeneous" "rgb sigma_a" [1 2 3]
MediumInterface "" "fog"
Camera "perspective" "float fov" [39.1]
Film "image" "integer xresolution" [320] "string filename" "b\"\\.exr"
Renderer "sampler"
WorldBegin
Texture "t" "float" "scale" "float tex1" 0.1
Texture "t" "color" "imagemap" "string filename" "a.png" "bool x" "false"
Translate 1 1 1
Material "matte" "texture Kd" "t" "float sigma" 1e-40 Shape "a"
MakeNamedMaterial "m" "string type" "mix" "string namedmaterial1" "none" "string namedmaterial2" "n"
MediumInterface "fog" ""
NamedMaterial "m" AreaLightSource "area" "rgb L" [1 1e30 0.3] Shape "b"
LightSource "distant" "point from" [-0 0 1] "vector v" [1 2 3] "normal n" [1 0 0] "point2 p" [1 2] "vector2 w" [3 4]
MediumInterface "" "fog"
WorldEnd)",
                    Dialect::v2)
      .scene;
}

Result<SceneDescription> decoded(const std::string& bytes) {
  return decode_scene(std::as_bytes(std::span(bytes)));
}

void expect_same(const Entity& a, const Entity& b) {
  EXPECT_EQ(a.type, b.type);
  EXPECT_EQ(a.location.to_string(), b.location.to_string());
  ASSERT_EQ(a.params.all().size(), b.params.all().size());
  for (std::size_t i = 0; i < a.params.all().size(); ++i) {
    const Param &p = a.params.all()[i], &q = b.params.all()[i];
    EXPECT_EQ(p.type, q.type);
    EXPECT_EQ(p.name, q.name);
    EXPECT_EQ(p.strings, q.strings);
    EXPECT_EQ(p.location.to_string(), q.location.to_string());
    EXPECT_EQ(p.used, q.used);
    ASSERT_EQ(p.reals.size(), q.reals.size());
    for (std::size_t j = 0; j < p.reals.size(); ++j)
      EXPECT_EQ(std::bit_cast<std::uint32_t>(p.reals[j]), std::bit_cast<std::uint32_t>(q.reals[j]));
    EXPECT_TRUE(
        std::equal(p.integers.begin(), p.integers.end(), q.integers.begin(), q.integers.end()));
  }
}

void expect_same(const Transform& a, const Transform& b) {
  EXPECT_EQ(a.matrix(), b.matrix());
  EXPECT_EQ(a.inverse_matrix(), b.inverse_matrix());
}

TEST(SceneCodec, GivesBackExactlyWhatItGot) {
  const SceneDescription a = sample();
  const auto result = decoded(encode(a));
  ASSERT_TRUE(result) << result.error();
  const SceneDescription& b = *result;
  EXPECT_EQ(a.dialect, b.dialect);
  EXPECT_EQ(a.source, b.source);
  expect_same(a.camera, b.camera);
  expect_same(a.camera.world_to_camera, b.camera.world_to_camera);
  expect_same(a.film, b.film);
  expect_same(a.sampler, b.sampler);
  expect_same(a.filter, b.filter);
  expect_same(a.integrator, b.integrator);
  ASSERT_TRUE(b.renderer);
  expect_same(*a.renderer, *b.renderer);
  EXPECT_FALSE(b.volume_integrator);
  ASSERT_EQ(a.textures.size(), b.textures.size());
  for (std::size_t i = 0; i < a.textures.size(); ++i) {
    expect_same(a.textures[i], b.textures[i]);
    expect_same(a.textures[i].texture_to_world, b.textures[i].texture_to_world);
    EXPECT_EQ(a.textures[i].name, b.textures[i].name);
    EXPECT_EQ(a.textures[i].is_float, b.textures[i].is_float);
  }
  ASSERT_EQ(a.materials.size(), b.materials.size());
  for (std::size_t i = 0; i < a.materials.size(); ++i) {
    expect_same(a.materials[i], b.materials[i]);
    expect_same(a.materials[i].object_to_world, b.materials[i].object_to_world);
  }
  ASSERT_EQ(a.lights.size(), b.lights.size());
  expect_same(a.lights[0], b.lights[0]);
  expect_same(a.lights[0].light_to_world, b.lights[0].light_to_world);
  ASSERT_EQ(a.area_lights.size(), 1u);
  ASSERT_EQ(b.area_lights.size(), 1u);
  expect_same(a.area_lights[0], b.area_lights[0]);
  ASSERT_EQ(b.media.size(), 1u);
  expect_same(a.media[0], b.media[0]);
  expect_same(a.media[0].medium_to_world, b.media[0].medium_to_world);
  EXPECT_EQ(b.camera.medium, MediumId(0));
  EXPECT_EQ(b.materials.back().inside, MediumId(0));
  EXPECT_EQ(b.materials.back().outside, MediumId());
  EXPECT_EQ(encode(a), encode(b));
}

TEST(SceneCodec, KeepsTheCamerasMovement) {
  SceneDescription a = sample();
  const std::size_t still = encode(a).size();
  a.transform_start = 2;
  a.transform_end = 3;
  a.camera.motion = Motion{Transform(glm::mat4(2.f)), 2, 3};
  const auto b = decoded(encode(a));
  ASSERT_TRUE(b) << b.error();
  ASSERT_TRUE(b->camera.motion);
  expect_same(a.camera.motion->end, b->camera.motion->end);
  EXPECT_EQ(b->camera.motion->start_time, 2.f);
  EXPECT_EQ(b->camera.motion->end_time, 3.f);
  EXPECT_FALSE(decoded(encode(sample()))->camera.motion);
  EXPECT_EQ(encode(sample()).size(), still);
}

TEST(SceneCodec, RejectsWhatDoesNotFit) {
  const auto fails = [](const std::function<void(proto::SceneDescription&)>& change) {
    proto::SceneDescription message;
    to_proto(sample(), message);
    EXPECT_TRUE(from_proto(message));
    change(message);
    return !from_proto(message);
  };
  using P = proto::SceneDescription;
  EXPECT_TRUE(fails([](P& m) { m.set_dialect(2); }));
  EXPECT_TRUE(fails([](P& m) { m.add_transform_times(1); }));
  EXPECT_TRUE(fails([](P& m) {
    m.add_transform_times(1);
    m.add_transform_times(0);
  }));
  EXPECT_TRUE(fails([](P& m) {
    for (int i = 0; i < 16; ++i) {
      m.mutable_camera()->mutable_world_to_camera_end()->add_matrix(0);
      m.mutable_camera()->mutable_world_to_camera_end()->add_inverse(kInfinity);
    }
  }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_film()->mutable_location()->set_file(99); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_film()->mutable_params(0)->set_type(11); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_film()->mutable_params(0)->add_reals(1); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_film()->mutable_params(0)->add_strings("x"); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_film()->mutable_params(1)->set_name("xresolution"); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_film()->mutable_params(1)->add_integers(1); }));
  EXPECT_TRUE(fails([](P& m) {
    m.mutable_textures(1)->mutable_entity()->mutable_params(1)->set_integers(0, 2);
  }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_textures(1)->set_name("t"); }));
  EXPECT_TRUE(fails([](P& m) { m.clear_textures(); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_materials(0)->set_outside(2); }));
  EXPECT_TRUE(fails([](P& m) { m.clear_media(); }));
  EXPECT_TRUE(
      fails([](P& m) { m.mutable_lights(0)->mutable_entity()->mutable_params(0)->add_reals(1); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_camera()->mutable_world_to_camera()->add_matrix(1); }));
  EXPECT_TRUE(fails([](P& m) { m.mutable_camera()->mutable_world_to_camera()->clear_inverse(); }));
  EXPECT_TRUE(fails([](P& m) { m.set_source(std::string(2 << 20, 'x')); }));
  EXPECT_TRUE(fails([](P& m) {
    for (int i = 0; i < 2000; ++i) m.mutable_film()->add_params()->set_name(std::to_string(i));
  }));
  for (const char* index : {"7", "-1", "x", "", "99999999999"})
    EXPECT_TRUE(fails([&](P& m) {
      for (auto& material : *m.mutable_materials())
        if (material.entity().type() == "mix")
          for (auto& p : *material.mutable_entity()->mutable_params())
            if (p.name() == "namedmaterial1") p.set_strings(0, index);
    })) << index;
}

TEST(SceneCodec, SurvivesAnyBytes) {
  std::mt19937 random(5);
  const std::string good = encode(sample());
  for (std::size_t n = 0; n < good.size(); ++n) (void)decoded(good.substr(0, n));
  for (int i = 0; i < 5000; ++i) {
    std::string bytes = good;
    for (unsigned j = 1 + random() % 4; j != 0; --j)
      bytes[random() % bytes.size()] = static_cast<char>(random());
    if (const auto scene = decoded(bytes)) encode(*scene);
  }
  for (int i = 0; i < 2000; ++i) {
    std::string bytes(random() % 200, '\0');
    for (char& c : bytes) c = static_cast<char>(random());
    (void)decoded(bytes);
  }
}

}  // namespace
}  // namespace cloudrenderer
