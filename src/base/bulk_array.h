#pragma once
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

namespace cloudrenderer {

// Read-only array of trivially copyable values with shared ownership. Small ones live on the heap; ones above
// kSpillBytes live in a mapped, already unlinked temporary file, so that reading a scene never needs anonymous memory
// in proportion to its size. Copies share the storage.
template <class T>
class BulkArray {
 public:
  BulkArray() = default;
  BulkArray(std::shared_ptr<const void> owner, std::span<const T> view)
      : owner_(std::move(owner)), view_(view) {}
  explicit BulkArray(std::vector<T> values) {
    auto held = std::make_shared<const std::vector<T>>(std::move(values));
    view_ = *held;
    owner_ = std::move(held);
  }

  std::span<const T> view() const { return view_; }
  std::size_t size() const { return view_.size(); }
  bool empty() const { return view_.empty(); }
  const T& operator[](std::size_t i) const { return view_[i]; }
  auto begin() const { return view_.begin(); }
  auto end() const { return view_.end(); }

 private:
  std::shared_ptr<const void> owner_;
  std::span<const T> view_;
};

// Untyped part of the writer: appends bytes to memory until kSpillBytes, then to a temporary file.
class BulkStorage {
 public:
  static constexpr std::size_t kSpillBytes = std::size_t{16} << 20;

  BulkStorage();
  ~BulkStorage();
  BulkStorage(BulkStorage&&) noexcept;
  BulkStorage& operator=(BulkStorage&&) noexcept;
  // Throws std::system_error when the temporary folder is full or cannot be written.
  void append(const void* data, std::size_t bytes);
  std::size_t bytes() const;
  struct Finished {
    std::shared_ptr<const void> owner;
    const std::byte* data = nullptr;
    std::size_t bytes = 0;
  };
  Finished finish();  // the storage is empty afterwards

 private:
  struct State;
  std::unique_ptr<State> state_;
};

template <class T>
class BulkWriter {
 public:
  void push_back(const T& v) { storage_.append(&v, sizeof(T)); }
  void append(std::span<const T> values) { storage_.append(values.data(), values.size_bytes()); }
  std::size_t size() const { return storage_.bytes() / sizeof(T); }
  BulkArray<T> finish() {
    BulkStorage::Finished f = storage_.finish();
    return {std::move(f.owner), {reinterpret_cast<const T*>(f.data), f.bytes / sizeof(T)}};
  }

 private:
  BulkStorage storage_;
};

}  // namespace cloudrenderer
