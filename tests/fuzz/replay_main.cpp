// replay FOLDER [MUTATIONS [SEED]]: a fuzz target without libFuzzer, for every build. Runs each
// file of the folder and a fixed number of seeded mutations of them. An input that crashes, hangs
// or takes all memory is written to crash-input; that file alone in a folder runs it again.
#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "fuzz/fuzz.h"

namespace {

using Bytes = std::vector<std::uint8_t>;
namespace fs = std::filesystem;

constexpr unsigned kSecondsPerInput = 10;
constexpr rlim_t kMostMemory = rlim_t{2} << 30;
constexpr std::size_t kLongest = std::size_t{1} << 16;
// What lies at the borders of lengths, counts and texts.
constexpr std::array<std::uint8_t, 10> kBorders{0, 1, 0x7f, 0x80, 0xff, '\n', ' ', '"', '[', '-'};

struct Current {
  const Bytes* bytes = nullptr;
  std::size_t number = 0;
} current;

// Only what a signal handler may call.
void report(int signal) {
  const int fd = open("crash-input", O_WRONLY | O_CREAT | O_TRUNC, 0644);
  if (fd >= 0 && current.bytes != nullptr)
    (void)!write(fd, current.bytes->data(), current.bytes->size());
  constexpr std::string_view kText = "the input is in crash-input\n";
  (void)!write(2, kText.data(), kText.size());
  std::signal(signal, SIG_DFL);
  (void)raise(signal);
}

std::vector<Bytes> read_folder(const fs::path& folder) {
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.is_regular_file()) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::vector<Bytes> files;
  for (const fs::path& p : paths) {
    std::ifstream in(p, std::ios::binary);
    files.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  return files;
}

class Mutator {
 public:
  Mutator(const std::vector<Bytes>& corpus, std::uint64_t seed) : corpus_(corpus), dice_(seed) {}

  Bytes next() {
    Bytes bytes = corpus_[below(corpus_.size())];
    for (std::size_t changes = 1 + below(4); changes > 0; --changes) change(bytes);
    bytes.resize(std::min(bytes.size(), kLongest));
    return bytes;
  }

 private:
  // The standard's distributions differ between libraries; the generator does not.
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(dice_() % n); }

  void change(Bytes& b) {
    if (b.empty()) return b.push_back(static_cast<std::uint8_t>(dice_()));
    const std::size_t at = below(b.size()),
                      length = 1 + below(std::min<std::size_t>(b.size() - at, 32));
    const auto here = b.begin() + static_cast<std::ptrdiff_t>(at);
    const auto end = here + static_cast<std::ptrdiff_t>(length);
    switch (below(8)) {
      case 0:
        b.resize(at);
        break;
      case 1:
        b.erase(here, end);
        break;
      case 2: {  // the same once more
        const Bytes copy(here, end);
        b.insert(here, copy.begin(), copy.end());
        break;
      }
      case 3:
        *here = kBorders[below(kBorders.size())];
        break;
      case 4:
        std::fill(here, std::min(end, here + 8), below(2) ? 0xff : 0);
        break;
      case 5: {  // goes on as another file
        const Bytes& other = corpus_[below(corpus_.size())];
        const std::size_t from = std::min(at, other.size());
        b.resize(at);
        b.insert(b.end(), other.begin() + static_cast<std::ptrdiff_t>(from), other.end());
        break;
      }
      case 6:
        *here = static_cast<std::uint8_t>(dice_());
        break;
      default:
        *here = static_cast<std::uint8_t>(*here ^ 1u << below(8));
    }
  }

  const std::vector<Bytes>& corpus_;
  std::mt19937_64 dice_;
};

void run(const Bytes& bytes) {
  current = {&bytes, current.number + 1};
  alarm(kSecondsPerInput);
  // A copy of exactly this size, for tools that watch its ends.
  const Bytes copy(bytes.begin(), bytes.end());
  LLVMFuzzerTestOneInput(copy.data(), copy.size());
}

void limit_memory() {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they map far more
  const rlimit limit{kMostMemory, kMostMemory};
  setrlimit(RLIMIT_AS, &limit);
#endif
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s FOLDER [MUTATIONS [SEED]]\n", argv[0]);
    return 2;
  }
  const std::size_t mutations = argc > 2 ? std::stoull(argv[2]) : 0;
  const std::uint64_t seed = argc > 3 ? std::stoull(argv[3]) : 1;
  const std::vector<Bytes> corpus = read_folder(argv[1]);
  if (corpus.empty()) {
    std::fprintf(stderr, "%s: no inputs in %s\n", argv[0], argv[1]);
    return 1;
  }
  limit_memory();
  for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGALRM})
    std::signal(signal, report);
  std::printf("%zu files, %zu mutations, seed %llu\n", corpus.size(), mutations,
              static_cast<unsigned long long>(seed));
  std::fflush(stdout);
  for (const Bytes& file : corpus) run(file);
  Mutator mutator(corpus, seed);
  for (std::size_t i = 0; i < mutations; ++i) run(mutator.next());
  alarm(0);
  std::printf("%zu inputs did no harm\n", current.number);
  return 0;
}
