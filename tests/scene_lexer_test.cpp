#include <gtest/gtest.h>
#include <zlib.h>

#include <string>
#include <vector>

#include "scene/lexer.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

Lexer lexer_of(const std::string& text) {
  return Lexer(SourceText::from_string("test.pbrt", text));
}

std::vector<std::string> words_of(const std::string& text) {
  Lexer lexer = lexer_of(text);
  std::vector<std::string> out;
  for (Token t = lexer.next(); t.kind != Token::Kind::end; t = lexer.next())
    out.emplace_back(t.text);
  return out;
}

std::vector<float> floats_of(const std::string& text) {
  Lexer lexer = lexer_of(text);
  EXPECT_EQ(lexer.next().kind, Token::Kind::open);
  const BulkArray<float> a = lexer.read_floats(true);
  EXPECT_EQ(lexer.next().text, "after");
  return {a.begin(), a.end()};
}

using Strings = std::vector<std::string>;

TEST(Lexer, CutsDirectives) {
  EXPECT_EQ(words_of("Shape \"sphere\" \"float radius\" [1 -2.5]"),
            (Strings{"Shape", "sphere", "float radius", "[", "1", "-2.5", "]"}));
  EXPECT_EQ(words_of("a[1]b"), (Strings{"a", "[", "1", "]", "b"}));
}

TEST(Lexer, EndsCommentsAtEitherEndOfLines) {
  const Strings both{"WorldBegin", "Shape"};
  for (const char* text : {"WorldBegin # one\nShape", "WorldBegin # one\r\nShape", "WorldBegin # one\rShape # two", "# a\r#b\rWorldBegin #\r Shape\r"})
    EXPECT_EQ(words_of(text), both) << text;
}

TEST(Lexer, SkipsCommentsCommasAndCarriageReturns) {
  EXPECT_EQ(words_of("a # b \"c\"\r\n1,2\r\n# end"), (Strings{"a", "1", "2"}));
  EXPECT_EQ(words_of("\xef\xbb\xbfWorldBegin"), (Strings{"WorldBegin"}));
  EXPECT_TRUE(words_of("").empty());
}

TEST(Lexer, KeepsTheHashInStrings) { EXPECT_EQ(words_of("\"a#b\" c"), (Strings{"a#b", "c"})); }

TEST(Lexer, KnowsWhereTokensAre) {
  Lexer lexer = lexer_of("one\n  two # x\n\n\t\"three\" [ 1\n2 ] four");
  const auto next = [&] { return lexer.location(lexer.next()).to_string(); };
  EXPECT_EQ(next(), "test.pbrt:1:1");
  EXPECT_EQ(next(), "test.pbrt:2:3");
  EXPECT_EQ(next(), "test.pbrt:4:2");
  EXPECT_EQ(next(), "test.pbrt:4:10");
  lexer.read_floats(true);
  EXPECT_EQ(next(), "test.pbrt:5:5");
}

TEST(Lexer, ReadsArraysOfEverySpelling) {
  EXPECT_EQ(floats_of("[1 2.5,3 # comment ] 9\r\n +4 1e+006\t.5] after"),
            (std::vector<float>{1, 2.5f, 3, 4, 1e6f, .5f}));
  EXPECT_TRUE(floats_of("[]after").empty());
}

TEST(Lexer, ReadsLongArrays) {
  std::string text = "[";
  for (int i = 0; i < 20000; ++i) text += std::to_string(i) + " ";
  const auto v = floats_of(text + "] after");
  ASSERT_EQ(v.size(), 20000u);
  for (std::size_t i = 0; i < v.size(); ++i) ASSERT_EQ(v[i], static_cast<float>(i));
}

TEST(Lexer, ReadsIntegersAndCutsFractions) {
  Lexer lexer = lexer_of("[1 -2 +3 4.0 1e3 5.7 2147483647 -2147483648]");
  lexer.next();
  std::uint64_t fractions = 0;
  const auto v = lexer.read_integers(fractions);
  EXPECT_EQ((std::vector<std::int32_t>{v.begin(), v.end()}),
            (std::vector<std::int32_t>{1, -2, 3, 4, 1000, 5, 2147483647, -2147483648}));
  EXPECT_EQ(fractions, 1u);
}

TEST(Lexer, SkipsArraysOfAnything) {
  Lexer lexer = lexer_of("[1 \"]\" # ]\n true ] after");
  lexer.next();
  lexer.skip_array();
  const Token t = lexer.next();
  EXPECT_EQ(t.text, "after");
  EXPECT_EQ(t.line, 2u);
}

TEST(Lexer, ResolvesEscapes) {
  EXPECT_EQ(Lexer::unescape("a\\\"b\\\\c\\n"), "a\"b\\c\n");
  EXPECT_EQ(Lexer::unescape("textures\\wood.png"), "textures\\wood.png");
  EXPECT_EQ(words_of("\"a\\\"b\" c"), (Strings{"a\\\"b", "c"}));
}

std::string gzipped(const std::string& text) {
  z_stream z{};
  EXPECT_EQ(deflateInit2(&z, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY), Z_OK);
  std::string in = text, out(text.size() + 1000, '\0');
  z.next_in = reinterpret_cast<Bytef*>(in.data());
  z.avail_in = static_cast<uInt>(in.size());
  z.next_out = reinterpret_cast<Bytef*>(out.data());
  z.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(deflate(&z, Z_FINISH), Z_STREAM_END);
  out.resize(z.total_out);
  deflateEnd(&z);
  return out;
}

TEST(SourceText, UnpacksGzipOfSeveralMembers) {
  const TemporaryFolder folder;
  std::string text;
  for (int i = 0; i < 100000; ++i) text += std::to_string(i) + " ";
  const auto opened = SourceText::open(folder.write("a.pbrt.gz", gzipped(text) + gzipped("tail")));
  ASSERT_TRUE(opened) << opened.error();
  EXPECT_EQ((*opened)->view(), text + "tail");
}

TEST(SourceText, RejectsDamagedGzip) {
  const TemporaryFolder folder;
  const std::string packed = gzipped(std::string(10000, 'x') + "yz");
  EXPECT_FALSE(SourceText::open(folder.write("cut", packed.substr(0, packed.size() / 2))));
  EXPECT_FALSE(SourceText::open(folder.write("head", packed.substr(0, 3))));
  std::string flipped = packed;
  flipped[packed.size() - 6] = static_cast<char>(flipped[packed.size() - 6] ^ 1);  // the checksum
  EXPECT_FALSE(SourceText::open(folder.write("flipped", flipped)));
}

TEST(SourceText, SaysWhyAFileCannotBeRead) {
  const TemporaryFolder folder;
  const auto missing = SourceText::open(folder.path("missing"));
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().find("No such file"), std::string::npos) << missing.error();
  EXPECT_FALSE(SourceText::open(folder.path("")));  // a folder
  const auto empty = SourceText::open(folder.write("empty", ""));
  ASSERT_TRUE(empty);
  EXPECT_TRUE((*empty)->view().empty());
}

}  // namespace
}  // namespace cloudrenderer
