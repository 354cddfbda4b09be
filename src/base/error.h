#pragma once
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

namespace cloudrenderer {

// A place in a scene file. The name is shared: copying is cheap.
struct FileLocation {
  std::shared_ptr<const std::string> file;
  std::uint32_t line = 0, column = 0;

  std::string to_string() const {  // "file:line:column", or "" when unknown
    if (!file) return {};
    return *file + ":" + std::to_string(line) + ":" + std::to_string(column);
  }
};

// The input cannot be rendered; a person can fix it. what() is "file:line:column: error: message".
class SceneError : public std::runtime_error {
 public:
  SceneError(const FileLocation& location, const std::string& message)
      : std::runtime_error((location.file ? location.to_string() + ": " : std::string()) + "error: " + message) {}
};

// Wrong command line: exit code 2.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// The cluster cannot do what was asked: exit code 4.
class ClusterError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// A value, or why there is none. For what a peer or a file may get wrong.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}  // NOLINT(google-explicit-constructor)
  static Result failure(std::string why) { return Result(std::in_place_index<1>, std::move(why)); }

  explicit operator bool() const { return state_.index() == 0; }
  T& value() { return std::get<0>(state_); }
  const T& value() const { return std::get<0>(state_); }
  T& operator*() { return value(); }
  const T& operator*() const { return value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }
  const std::string& error() const { return std::get<1>(state_); }

 private:
  template <std::size_t I, class U>
  Result(std::in_place_index_t<I> i, U&& u) : state_(i, std::forward<U>(u)) {}
  std::variant<T, std::string> state_;
};

}  // namespace cloudrenderer
