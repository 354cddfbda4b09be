#pragma once
// The states of a task and the legal moves between them: one table, see design section 4.
#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "base/id.h"
#include "wire/messages.h"

namespace cloudrenderer {

enum class TaskCategory : std::uint8_t {
  loader,
  unloader,
  renderer,
  tracer,
  aggregator,
  intersection
};
inline constexpr std::size_t kTaskCategories = 6;
const char* name(TaskCategory c);

// new, ready, waiting, submitting, replying are the five queues; running is held by a thread; end
// is gone.
enum class TaskState : std::uint8_t { fresh, ready, running, waiting, submitting, replying, end };
inline constexpr std::size_t kTaskStates = 7;
const char* name(TaskState s);

enum class TaskMove : std::uint8_t {
  a_accept,         // fresh -> ready: this host can process it
  b_run,            // ready -> running: a compute thread takes it
  c_finish,         // running -> replying: finished, nothing generated that it must wait for
  d_delegate,       // fresh -> submitting: this host cannot process it
  e_resubmit,       // submitting -> submitting: try again, or another host
  f_submitted,      // submitting -> waiting: the reply is to come
  g_generated,      // running -> waiting: it waits for what it has generated
  h_collected,      // waiting -> ready: all that it waits for is here
  i_reply_again,    // replying -> replying
  j_replied,        // replying -> end: the reply is confirmed, or the submitter has left
  k_target_lost,    // waiting -> end: its unanswered segments become new tasks
  l_discard,        // any but end -> end: submitter lost, job cancelled, another copy won
  m_part_unloaded,  // ready -> fresh
  n_load_first,     // fresh -> waiting: it generated a loader task
  o_refused,        // waiting -> fresh: the target is no holder
  p_map_changed,    // submitting -> fresh
};
inline constexpr std::size_t kTaskMoves = 16;

struct MoveRule {
  TaskMove move;
  TaskState from;  // `end` in the rule of l_discard means: any but end
  TaskState to;
};
std::span<const MoveRule> move_table();
// The state after the move, or none if the table does not allow it.
std::optional<TaskState> after(TaskMove move, TaskState from);

struct Task {
  wire::TaskUuid id;
  TaskCategory category = TaskCategory::tracer;
  TaskState state = TaskState::fresh;
  HostId submitter;             // who gets the reply
  HostId target;                // whom it was submitted to
  std::uint32_t waits_for = 0;  // replies and generated tasks

  // False, and nothing happens, when the move is illegal: for moves that a message asks for.
  bool try_move(TaskMove move);
  // For our own moves: an illegal one is a bug of ours.
  void move(TaskMove move);
};

}  // namespace cloudrenderer
