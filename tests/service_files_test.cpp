// Uploads and the folders that are made of them.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "cluster/temp_folder.h"
#include "service/scene_files.h"
#include "service/upload_request.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

std::string text_of(const std::string& path) {
  std::ostringstream out;
  out << std::ifstream(path).rdbuf();
  return out.str();
}

TEST(Sha256, AgreesWithTheStandardsExamples) {  // FIPS 180-4's "abc", and the empty message
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_FALSE(is_sha256(std::string(63, 'a') + "G"));
}

TEST(ScenePaths, OnlyPathsBelowTheFolderArePaths) {
  for (const char* good : {"a", "a.pbrt", "a/b/c.ply", "..a/b..", "a b/\xc3\xa4.png", ".hidden"}) EXPECT_EQ(path_fault(good), "") << good;
  for (const std::string& bad : {std::string(""), std::string("/a"), std::string("a//b"), std::string("a/"), std::string("."), std::string(".."), std::string("a/../b"), std::string("../a"), std::string("a/."),
                                 std::string("a\\b"), std::string("a\nb"), std::string("a\0b", 3), std::string(1025, 'a'), std::string(256, 'a'),
                                 [] { std::string deep = "a"; for (int i = 0; i < 64; ++i) deep += "/a"; return deep; }()})
    EXPECT_NE(path_fault(bad), "") << bad;
}

TEST(ScenePaths, ManifestsThatMakeNoFolderAreRefused) {
  const std::string hash = sha256("x");
  const auto file = [&](const std::string& path, const std::string& h = "") {
    return R"({"path": ")" + path + R"(", "sha256": ")" + (h.empty() ? hash : h) + R"(", "bytes": 1})";
  };
  const auto read = [](const std::string& files) { return read_manifest(parse_json(R"({"files": [)" + files + "]}")); };
  EXPECT_EQ(read(file("a") + "," + file("b/c")).size(), 2u);
  for (const std::string& bad : {std::string(), file("../a"), file("a") + "," + file("a"), file("a") + "," + file("a/b"), file("a", "ABC"), std::string("3"),
                                 R"({"path": "a", "sha256": ")" + hash + "\"}", R"({"path": "a", "sha256": ")" + hash + R"(", "bytes": -1})"})
    EXPECT_THROW(read(bad), ApiError) << bad;
}

TEST(Uploads, GoOnWhereTheyEndedAndAreChecked) {
  const TemporaryFolder folder;
  BlobStore store(folder.path());
  std::mt19937 random(3);
  std::string bytes(100'000, '\0');
  for (char& c : bytes) c = static_cast<char>(random());
  const std::string hash = sha256(bytes);
  std::size_t at = 0;
  while (at < bytes.size()) {  // pieces of any length, also of connections that break off
    const std::size_t n = std::min<std::size_t>(bytes.size() - at, random() % 30'000);
    const auto upload = store.upload("ann", hash, at, bytes.size());
    upload->add(std::string_view(bytes).substr(at, n));
    at += n;
    EXPECT_EQ(upload->finish(), at == bytes.size());
  }
  EXPECT_EQ(text_of(store.path(hash)), bytes);
  EXPECT_EQ(store.offset("ann", hash), 0u);
}

TEST(Uploads, AreRefusedWhereTheyDoNotFit) {
  const TemporaryFolder folder;
  BlobStore store(folder.path());
  const std::string hash = sha256("hello");
  store.upload("ann", hash, 0, 5)->add("he");
  EXPECT_EQ(store.offset("ann", hash), 2u);
  EXPECT_EQ(store.offset("bob", hash), 0u) << "of others nothing is told";
  EXPECT_THROW(store.upload("ann", hash, 0, 5), ApiError);
  EXPECT_THROW(store.upload("ann", hash, 3, 5), ApiError);
  {
    const auto upload = store.upload("ann", hash, 2, 5);
    EXPECT_THROW(store.upload("ann", hash, 2, 5), ApiError) << "another one is at it";
    EXPECT_THROW(upload->add("too much"), ApiError);
    upload->add("XXX");
    EXPECT_THROW(upload->finish(), ApiError) << "other bytes than the name says";
  }
  EXPECT_FALSE(fs::exists(store.path(hash)));
  const auto again = store.upload("ann", hash, 0, 5);
  again->add("hello");
  EXPECT_TRUE(again->finish());
}

TEST(Uploads, ScenesAreFoldersOfLinks) {
  const TemporaryFolder folder;
  BlobStore store(folder.path());
  for (const char* text : {"one", "two"}) {
    const auto upload = store.upload("ann", sha256(text), 0, 3);
    upload->add(text);
    upload->finish();
  }
  const std::string scene = folder.path() + "/scene";
  store.materialise({{"a", {sha256("one"), 3}}, {"b/c", {sha256("two"), 3}}, {"b/d", {sha256("one"), 3}}}, scene);
  EXPECT_EQ(text_of(scene + "/a"), "one");
  EXPECT_EQ(text_of(scene + "/b/c"), "two");
  EXPECT_EQ(fs::hard_link_count(scene + "/a"), 3u);
  EXPECT_EQ(fs::status(scene + "/b").permissions(), fs::perms(0555));
  for (const char* path : {"", "/b"}) fs::permissions(scene + path, fs::perms(0755));  // for who removes it
}

TEST(Uploads, ContentRangesAreRead) {
  const auto range = parse_content_range("bytes 10-19/100");
  ASSERT_TRUE(range);
  EXPECT_EQ(range->first, 10u);
  EXPECT_EQ(range->length, 10u);
  EXPECT_EQ(range->total, 100u);
  for (const char* bad : {"", "bytes", "bytes ", "bytes 0-0/0", "bytes 5-4/10", "bytes 0-10/10", "bytes 0-9/*", "bytes */10", "bytes -1-9/10",
                          "bytes 0-9/10 ", "items 0-9/10", "bytes 0-9", "bytes 0-9/99999999999999999999", "bytes 18446744073709551615-0/1"})
    EXPECT_FALSE(parse_content_range(bad)) << bad;
}

}  // namespace
}  // namespace cloudrenderer
