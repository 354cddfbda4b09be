#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "film/film.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

class Folder {
 public:
  Folder() {
    std::string name = (fs::temp_directory_path() / "film_test_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = name;
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }
  std::size_t files() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(path_), fs::directory_iterator()));
  }

 private:
  fs::path path_;
};

Image noise(std::uint32_t width, std::uint32_t height, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::lognormal_distribution<float> value(0.f, 3.f);
  Image out{width, height, std::vector<Rgb>(std::size_t{width} * height)};
  for (Rgb& c : out.pixels) c = {value(random), value(random), -value(random)};
  return out;
}

FilmFrame full(const Image& i) { return {i.width, i.height, 0, 0, i.width, i.height}; }

std::string error_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return {};
}

TEST(ImageFile, ExrComesBackBitForBit) {
  const Folder folder;
  const Image image = noise(33, 21);
  write_image(folder / "a.exr", image, full(image));
  const Image back = read_image(folder / "a.exr");
  ASSERT_EQ(back.width, 33u);
  ASSERT_EQ(back.height, 21u);
  EXPECT_EQ(std::memcmp(back.pixels.data(), image.pixels.data(), image.pixels.size() * sizeof(Rgb)),
            0);
  EXPECT_EQ(folder.files(), 1u) << "no temporary file stays";
}

TEST(ImageFile, ExrCarriesWindowsAndMetadata) {
  const Folder folder;
  const Image image = noise(5, 4);
  write_image(folder / "a.exr", image, {100, 80, 10, 20, 15, 24},
              {.words = {{"spp", "64"}, {"cloudrenderer:seed", "7 8"}}, .matrices = {}});
  const auto in = OIIO::ImageInput::open(folder / "a.exr");
  ASSERT_TRUE(in);
  const OIIO::ImageSpec& s = in->spec();
  EXPECT_EQ(s.x, 10);
  EXPECT_EQ(s.y, 20);
  EXPECT_EQ(s.width, 5);
  EXPECT_EQ(s.height, 4);
  EXPECT_EQ(s.full_x, 0);
  EXPECT_EQ(s.full_y, 0);
  EXPECT_EQ(s.full_width, 100);
  EXPECT_EQ(s.full_height, 80);
  EXPECT_EQ(s.format, OIIO::TypeDesc::FLOAT);
  EXPECT_EQ(s.channelnames, (std::vector<std::string>{"R", "G", "B"}));
  EXPECT_EQ(s.get_string_attribute("spp"), "64");
  EXPECT_EQ(s.get_string_attribute("cloudrenderer:seed"), "7 8");
}

TEST(ImageFile, ExrCarriesOtherChannelsAndMatrices) {
  const Folder folder;
  const Image image = noise(5, 4);
  std::vector<float> depths(20);
  std::vector<std::uint32_t> ids(20);
  for (std::size_t i = 0; i < 20; ++i) {
    depths[i] = 0.1f * static_cast<float>(i);
    ids[i] = 0xfffffff0u + static_cast<std::uint32_t>(i % 16);  // no float has all these bits
  }
  const std::vector<ImageChannel> channels{{"depth.Z", depths}, {"id.shape", ids}};
  const Mat4 moved{1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 3, 0, 4, 5, 6, 1};
  write_image(folder / "a.exr", image, full(image), {{}, {{"worldToCamera", moved}, {"worldToNDC", 2.f * moved}}}, channels);
  EXPECT_EQ(read_image(folder / "a.exr").pixels, image.pixels);
  const auto in = OIIO::ImageInput::open(folder / "a.exr");
  ASSERT_TRUE(in);
  const OIIO::ImageSpec& s = in->spec();
  ASSERT_EQ(s.nchannels, 5);
  std::vector<float> read_depths(20);
  std::vector<std::uint32_t> read_ids(20);
  const int depth = s.channelindex("depth.Z"), id = s.channelindex("id.shape");
  ASSERT_TRUE(in->read_image(0, 0, depth, depth + 1, OIIO::TypeDesc::FLOAT, read_depths.data()));
  ASSERT_TRUE(in->read_image(0, 0, id, id + 1, OIIO::TypeDesc::UINT, read_ids.data()));
  EXPECT_EQ(read_depths, depths);
  EXPECT_EQ(read_ids, ids);
  Mat4 read;
  ASSERT_TRUE(s.getattribute("worldtocamera", OIIO::TypeDesc::TypeMatrix, &read[0][0]));
  EXPECT_EQ(read, moved);
  std::ifstream file(folder / "a.exr", std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(file), {});
  EXPECT_NE(bytes.find(std::string("worldToCamera\0m44f", 18)), std::string::npos) << "OpenEXR's name";
  EXPECT_NE(bytes.find(std::string("worldToNDC\0m44f", 15)), std::string::npos);
}

TEST(ImageFile, EqualPicturesGiveEqualFiles) {
  const Folder folder;
  const Image image = noise(40, 40);
  const auto bytes = [](const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  write_image(folder / "a.exr", image, full(image), {.words = {{"spp", "1"}}, .matrices = {}});
  write_image(folder / "b.exr", image, full(image), {.words = {{"spp", "1"}}, .matrices = {}});
  EXPECT_EQ(bytes(folder / "a.exr"), bytes(folder / "b.exr"));
}

TEST(ImageFile, NamesOtherColoursThanThoseOfSrgb) {
  const Folder folder;
  Image image = noise(2, 2);
  image.space = ColorSpace::find("aces2065-1");
  write_image(folder / "a.exr", image, full(image));
  std::array<float, 8> read{};
  ASSERT_TRUE(OIIO::ImageInput::open(folder / "a.exr")->spec().getattribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), read.data()));
  EXPECT_EQ(read, image.space->chromaticities());
  image.space.reset();
  write_image(folder / "b.exr", image, full(image));
  EXPECT_EQ(OIIO::ImageInput::open(folder / "b.exr")->spec().find_attribute("chromaticities"), nullptr);
}

TEST(ImageFile, PngIsSrgb) {
  const Folder folder;
  Image image{4, 1, {Rgb(0.f), Rgb(1.f), Rgb(0.2158605f), Rgb(-3.f, 7.f, 0.0021f)}};
  write_image(folder / "a.png", image, full(image));
  const auto in = OIIO::ImageInput::open(folder / "a.png");
  ASSERT_TRUE(in);
  unsigned char pixels[12];
  ASSERT_TRUE(in->read_image(0, 0, 0, 3, OIIO::TypeDesc::UINT8, pixels));
  const unsigned char expected[12] = {0, 0, 0, 255, 255, 255, 128, 128, 128, 0, 255, 7};
  EXPECT_EQ(std::memcmp(pixels, expected, 12), 0);
  const Image back = read_image(folder / "a.png");
  EXPECT_NEAR(back.pixels[2].x, 0.2158605f, 1e-5f) << "read as linear";
}

TEST(ImageFile, TgaIsSrgbToo) {
  const Folder folder;
  const Image image{2, 2, {Rgb(0.f), Rgb(1.f), Rgb(0.2158605f, 0.f, 1.f), Rgb(0.f, 9.f, 0.f)}};
  write_image(folder / "a.tga", image, full(image));
  const Image back = read_image(folder / "a.tga");
  ASSERT_EQ(back.pixels.size(), 4u);
  EXPECT_NEAR(back.pixels[2].x, 0.2158605f, 1e-5f);
  EXPECT_EQ(back.pixels[2].z, 1.f);
  EXPECT_EQ(back.pixels[3], Rgb(0.f, 1.f, 0.f));
}

TEST(ImageFile, PfmKeepsEveryBitFromTheBottomUp) {
  const Folder folder;
  const Image image = noise(5, 3);
  write_image(folder / "a.pfm", image, full(image));
  std::ifstream in(folder / "a.pfm", std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  const std::string header = "PF\n5 3\n-1\n";
  ASSERT_EQ(bytes.size(), header.size() + 5 * 3 * sizeof(Rgb));
  EXPECT_EQ(bytes.substr(0, header.size()), header);
  EXPECT_EQ(std::memcmp(bytes.data() + header.size(), &image.pixels[10], 5 * sizeof(Rgb)), 0);
  const Image back = read_image(folder / "a.pfm");
  ASSERT_EQ(back.pixels.size(), image.pixels.size());
  EXPECT_EQ(std::memcmp(back.pixels.data(), image.pixels.data(), 15 * sizeof(Rgb)), 0);
}

TEST(ImageFile, ReplacesAnOldFile) {
  const Folder folder;
  std::ofstream(folder / "a.exr") << "something else";
  const Image image = noise(3, 3);
  write_image(folder / "a.exr", image, full(image));
  EXPECT_EQ(read_image(folder / "a.exr").width, 3u);
}

TEST(ImageFile, SaysWhyItCannotBeWritten) {
  const Folder folder;
  const Image image = noise(3, 3);
  const auto write = [&](const std::string& path) {
    return error_of([&] { write_image(path, image, full(image)); });
  };
  EXPECT_NE(write(folder / "no/such/a.exr").find("No such file or directory"), std::string::npos);
  EXPECT_NE(write(folder / "a.jpg").find(".exr, .pfm, .png or .tga"), std::string::npos);
  fs::create_directory(folder / "d.exr");
  EXPECT_NE(write(folder / "d.exr").find("Is a directory"), std::string::npos);
  EXPECT_EQ(folder.files(), 1u) << "no temporary file stays";
  EXPECT_NE(error_of([&] {
              write_image(folder / "b.exr", image, {4, 4, 0, 0, 4, 4});
            }).find("size"),
            std::string::npos);
  if (::access("/dev/full", W_OK) == 0) {
    // A temporary name that is a link to a full device: the disk is full while writing.
    fs::create_symlink("/dev/full", folder / ("c.exr.tmp" + std::to_string(::getpid())));
    EXPECT_NE(write(folder / "c.exr").find("No space left"), std::string::npos);
    EXPECT_FALSE(fs::exists(folder / "c.exr"));
  }
}

TEST(ImageFile, SaysWhyItCannotBeRead) {
  const Folder folder;
  EXPECT_NE(error_of([&] { read_image(folder / "none.exr"); }).find("No such file"),
            std::string::npos);
  std::ofstream(folder / "bad.exr") << "not a picture";
  EXPECT_NE(error_of([&] { read_image(folder / "bad.exr"); }).find("bad.exr"), std::string::npos);
  const Image image = noise(64, 64);
  write_image(folder / "cut.exr", image, full(image));
  fs::resize_file(folder / "cut.exr", 3000);
  EXPECT_NE(error_of([&] { read_image(folder / "cut.exr"); }), "");
}

TEST(CompareImages, GivesTheNumbersOfTheReferenceTool) {
  // Values of exrcmp.py for these pictures.
  Image a{4, 1, {{1, 1, 1}, {2, 2, 2}, {0, 0.5f, 0}, {4, 3, 2}}};
  Image b{4, 1, {{1, 1, 1}, {1, 2, 4}, {0, 0, 0}, {4, 3, 2}}};
  const ImageDifference d = compare_images(a, b);
  const double relative = (1 / 1.01 + 4 / 16.01 + 0.25 / 0.01) / 12;
  EXPECT_NEAR(d.relmse, relative, 1e-12);
  EXPECT_NEAR(d.relmse_trimmed, (1 / 1.01 + 4 / 16.01) / 9, 1e-12)
      << "the worst of four pixels is left out";
  EXPECT_NEAR(d.mse, (1 + 4 + 0.25) / 12, 1e-12);
  EXPECT_NEAR(d.psnr, -10 * std::log10(5.25 / 12), 1e-9);
  EXPECT_EQ(d.largest, 2);
  EXPECT_NEAR(d.mean_ratio[0], 7. / 6, 1e-12);
  EXPECT_NEAR(d.mean_ratio[1], 6.5 / 6, 1e-12);
  EXPECT_NEAR(d.mean_ratio[2], 5. / 7, 1e-12);
  EXPECT_FALSE(d.identical);
}

TEST(CompareImages, LeavesBrightOutliersOutOfTheRatio) {
  Image b{1000, 1, std::vector<Rgb>(1000, Rgb(1.f))}, a = b;
  for (std::size_t i = 0; i < 4; ++i) {
    a.pixels[i * 100] = Rgb(3000.f);
    b.pixels[i * 100] = Rgb(1e5f);
  }
  EXPECT_NEAR(compare_images(a, b).mean_ratio[0], 1, 1e-12);
}

TEST(CompareImages, KnowsIdenticalPictures) {
  const Image a = noise(9, 9);
  const ImageDifference d = compare_images(a, a);
  EXPECT_TRUE(d.identical);
  EXPECT_EQ(d.relmse, 0);
  EXPECT_EQ(d.largest, 0);
  EXPECT_TRUE(std::isinf(d.psnr));
  EXPECT_NEAR(d.mean_ratio[0], 1, 1e-12);
}

TEST(CompareImages, RefusesWhatCannotBeCompared) {
  const Image a = noise(9, 9);
  Image b = a;
  EXPECT_THROW(compare_images(a, noise(9, 8)), std::runtime_error);
  b.pixels[5].y = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(compare_images(b, a), std::runtime_error);
  EXPECT_THROW(compare_images(b, a, true), std::runtime_error);
  EXPECT_THROW(compare_images(a, b), std::runtime_error);
  EXPECT_EQ(compare_images(a, b, true).relmse, 0);
  b.pixels[5].y = kInfinity;
  EXPECT_THROW(compare_images(a, b), std::runtime_error);
}

}  // namespace
}  // namespace cloudrenderer
