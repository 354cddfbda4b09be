#pragma once
// Loaded parts that the scenes of one process share: what two scenes have in common is loaded once, and what a scene has
// left behind stays for the next one while there is room. Any thread.
#include <compare>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "parts/part.h"
#include "trace/bvh_form.h"

namespace cloudrenderer {

class Device;
class LoadedPart;

// What decides a loaded part. Parts with file 0 are of one scene only.
struct PartKey {
  std::uint64_t file = 0;        // the checksum of its file
  std::uint64_t bytes = 0;       // the file's length
  std::uint64_t prototypes = 0;  // a hash of those that it needs, with their numbers
  bool passing = false;          // BvhForm
  friend auto operator<=>(const PartKey&, const PartKey&) = default;
};
PartKey part_key(const Manifest& manifest, std::uint32_t part, BvhForm form);
PartKey prototype_key(const Manifest& manifest, std::uint32_t prototype);

class PartCache {
 public:
  struct Options {
    unsigned threads = 1;           // that join a build; there is one build at a time
    std::string isa = kEmbreeIsa;
    std::uint64_t memory = ~std::uint64_t{0};  // for all that is loaded
  };
  explicit PartCache(Options options);
  ~PartCache();
  PartCache(const PartCache&) = delete;
  PartCache& operator=(const PartCache&) = delete;

  using Loaded = std::shared_ptr<const LoadedPart>;
  using Build = std::function<Loaded(const std::shared_ptr<Device>&)>;
  // The part, for one more user; built by `make` if it is not there. `make` prepares (reads, fetches) and gives the
  // function that builds; only that is done one at a time. Who wants a part that is just being built waits for it.
  Loaded take(const PartKey& key, const std::function<Build()>& make, bool& there);
  void give_back(const Loaded& part);  // by a user; it may stay
  bool has(const PartKey& key) const;

  // What a user is about to take: room for what is not there, and what is there stays, until release(). Drops what
  // nobody uses, the longest unused first. False: there is no room. A new call takes the place of the last one.
  struct Need {
    PartKey key;
    std::uint64_t bytes = 0;  // when it must be loaded, the build included
  };
  bool reserve(const void* user, std::vector<Need> needs);
  void release(const void* user);
  void add_other(std::int64_t bytes);  // of what else counts: textures
  // Drops what cannot be shared and nobody uses, and what is above the budget. Nothing while a part is being built.
  void tidy();

  std::uint64_t bytes() const;       // all that is loaded
  std::uint64_t peak_bytes() const;  // the most that bytes() has been, builds included
  double share_of(std::span<const Loaded> parts) const;  // bytes, each divided by its users
  std::uint64_t budget() const { return options_.memory; }

 private:
  struct Entry {
    Loaded part;
    unsigned users = 0;
    std::uint64_t left = 0;  // when the last user has left it
  };
  struct Reserved {
    std::uint64_t bytes = 0;
    std::vector<Need> needs;
  };
  void drop_idle(std::uint64_t needed);  // with both mutexes
  bool drop_some(std::uint64_t needed);

  const Options options_;
  std::shared_ptr<Device> device_;
  std::mutex build_mutex_;  // before mutex_: building and dropping, by which the device's bytes change
  mutable std::mutex mutex_;
  std::condition_variable finished_;
  std::map<PartKey, Entry> entries_;
  std::map<const LoadedPart*, PartKey> keys_;
  std::set<PartKey> building_;
  std::map<const void*, Reserved> reserved_;
  std::uint64_t clock_ = 0, unshared_ = 0;
};

}  // namespace cloudrenderer
