#pragma once
#include <time.h>

#include <cstdint>

namespace cloudrenderer {

// What this process uses, as the system counts it.
double cpu_seconds();           // of all its threads so far
double clock_seconds(clockid_t clock);
double thread_cpu_seconds();    // of the calling thread
std::uint64_t peak_rss();       // VmHWM: the most memory that was ever resident
std::uint64_t anonymous_rss();  // RssAnon: resident now and not backed by a file

// What the machine, or the container around this process, has.
std::uint64_t
available_memory();            // bytes: the smaller of the cgroup's limit and the machine's memory
unsigned available_threads();  // processors that this process may run on

}  // namespace cloudrenderer
