// Compiled for any x86-64 processor, unlike the rest of the program: says what is missing instead of dying of an illegal
// instruction.
#include <unistd.h>

#include <cstring>

namespace cloudrenderer {
namespace {

constexpr int kCannotTakePart = 4;  // exit codes: README.md

void check_processor() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2")) return;
  constexpr const char* kText =
      "cloudrenderer: this processor lacks the instructions AVX2, FMA and BMI2 (x86-64-v3), for which the program is made: all "
      "hosts of a cluster compute with the same ones, so that the picture has the same bits\n";
  if (write(STDERR_FILENO, kText, std::strlen(kText)) < 0) _exit(kCannotTakePart);
  _exit(kCannotTakePart);
}

// Before all other code of the program, whose initialisation may use what is missing: protobuf's comes before any
// constructor function's priority.
__attribute__((section(".preinit_array"), used)) void (*const first)() = check_processor;

}  // namespace
}  // namespace cloudrenderer
