#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <future>
#include <iterator>
#include <thread>

#include "cluster/checkpoint_file.h"
#include "cluster/temp_folder.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;
using Place = CheckpointFile::Place;

Bytes bytes_of(const std::string& text) {
  Bytes b;
  for (const char c : text) b.push_back(static_cast<std::byte>(c));
  return b;
}

std::string read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// What opening says; "": it can be opened.
std::string refusal(const std::string& path) {
  try {
    CheckpointFile file(path);
    return "";
  } catch (const UsageError& e) {
    return e.what();
  }
}

template <class F>
bool soon(F condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (!condition() && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return condition();
}

struct CheckpointFileTest : testing::Test {
  TemporaryFolder folder;
  std::string path = folder.path() + "/a.ckpt";
};

TEST_F(CheckpointFileTest, IsAppendedToAndReplacedInOrder) {
  CheckpointFile file(path);
  file.append(bytes_of("one "));
  file.append(bytes_of("two "));
  file.replace(bytes_of("12 "));
  file.append(bytes_of("three"));
  EXPECT_EQ(file.bytes(), 8u);
  file.close();
  EXPECT_EQ(file.error(), "");
  EXPECT_EQ(read(path), "12 three");
  EXPECT_FALSE(fs::exists(path + ".new"));
}

TEST_F(CheckpointFileTest, IsLockedAgainstASecondRenderAlsoWhenReplaced) {
  CheckpointFile file(path);
  EXPECT_NE(refusal(path).find("another render is using it"), std::string::npos);
  file.replace(bytes_of("anew"));
  ASSERT_TRUE(soon([&] { return read(path) == "anew"; }));
  EXPECT_NE(refusal(path).find("another render is using it"), std::string::npos);
  file.append(bytes_of("er"));
  file.close();
  EXPECT_EQ(read(path), "anewer");
}

// Who opens it just before it is replaced, and locks it just after, would hold a file without a
// name, and its next compaction would put an end to the other's journal. A lease keeps the opening
// waiting between the two.
TEST_F(CheckpointFileTest, IsNotOpenedAsTheFileThatItWasBeforeItWasReplaced) {
  signal(SIGIO, SIG_IGN);  // that the lease is asked back
  std::ofstream(path) << "old";
  std::ofstream(path + ".b") << "new";
  const int before = open(path.c_str(), O_RDWR | O_CLOEXEC);
  const int after = open((path + ".b").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_EQ(flock(after, LOCK_EX), 0);
  if (fcntl(before, F_SETLEASE, F_WRLCK) != 0) GTEST_SKIP() << "this file system has no leases";
  auto said = std::async(std::launch::async, [&] { return refusal(path); });
  EXPECT_TRUE(soon([&] { return fcntl(before, F_GETLEASE) != F_WRLCK; }));
  fs::rename(path + ".b", path);
  EXPECT_EQ(fcntl(before, F_SETLEASE, F_UNLCK), 0);
  EXPECT_NE(said.get().find("another render is using it"), std::string::npos);
  EXPECT_EQ(read(path), "new");
  close(before);
  close(after);
  EXPECT_EQ(refusal(path), "");
}

TEST_F(CheckpointFileTest, KnowsWhenItsNameLeadsNowhereOrElsewhere) {
  CheckpointFile file(path);
  file.append(bytes_of("old"));
  ASSERT_TRUE(soon([&] { return read(path) == "old"; }));
  EXPECT_EQ(file.place(), Place::here);
  fs::rename(path, path + ".moved");
  EXPECT_EQ(file.place(), Place::gone);
  file.replace(bytes_of("new"));
  EXPECT_EQ(file.place(), Place::here) << "it is on the way";
  ASSERT_TRUE(soon([&] { return read(path) == "new"; }));
  EXPECT_EQ(file.place(), Place::here);
  EXPECT_EQ(read(path + ".moved"), "old");
  fs::rename(path + ".moved", path);
  // The thread may still be about to say that it has replaced the file.
  EXPECT_TRUE(soon([&] { return file.place() == Place::taken; }));
  file.fail("another file has taken its place");
  EXPECT_EQ(file.error(), "cannot write the checkpoint " + path + ": another file has taken its place");
  file.append(bytes_of("more"));
  file.close();
  EXPECT_EQ(read(path), "old");
}

TEST_F(CheckpointFileTest, SaysWhenItsFolderIsGone) {
  const std::string inner = folder.path() + "/inner";
  fs::create_directory(inner);
  CheckpointFile file(inner + "/a.ckpt");
  fs::remove_all(inner);
  EXPECT_EQ(file.place(), Place::gone);
  file.replace(bytes_of("new"));
  file.close();
  EXPECT_NE(file.error().find("No such file or directory"), std::string::npos);
}

TEST_F(CheckpointFileTest, RemovesWhatAKilledCompactionHasLeft) {
  std::ofstream(path) << "journal";
  std::ofstream(path + ".new") << "half";
  CheckpointFile file(path);
  EXPECT_FALSE(fs::exists(path + ".new"));
  EXPECT_EQ(file.bytes(), 7u);
}

TEST_F(CheckpointFileTest, AnInterruptOverwritesNobodysCheckpoint) {
  EXPECT_EQ(write_beside(path, bytes_of("1")), path);
  EXPECT_EQ(write_beside(path, bytes_of("2")), path);
  EXPECT_EQ(write_beside(path, bytes_of("3")), path);
  EXPECT_EQ(read(path), "3");
  EXPECT_EQ(read(path + "~"), "1");
  EXPECT_EQ(read(path + "~2"), "2");
  CheckpointFile running(path);
  EXPECT_EQ(write_beside(path, bytes_of("4")), path + "~3");
  EXPECT_EQ(read(path), "3");
  EXPECT_EQ(running.place(), Place::here);
}

}  // namespace
}  // namespace cloudrenderer
