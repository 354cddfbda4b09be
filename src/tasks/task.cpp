#include "tasks/task.h"

#include <cassert>

namespace cloudrenderer {
namespace {

using enum TaskState;
using enum TaskMove;

constexpr std::array<MoveRule, kTaskMoves> kMoves = {{
    {a_accept, fresh, ready},
    {b_run, ready, running},
    {c_finish, running, replying},
    {d_delegate, fresh, submitting},
    {e_resubmit, submitting, submitting},
    {f_submitted, submitting, waiting},
    {g_generated, running, waiting},
    {h_collected, waiting, ready},
    {i_reply_again, replying, replying},
    {j_replied, replying, end},
    {k_target_lost, waiting, end},
    {l_discard, end, end},  // from any but end
    {m_part_unloaded, ready, fresh},
    {n_load_first, fresh, waiting},
    {o_refused, waiting, fresh},
    {p_map_changed, submitting, fresh},
}};

}  // namespace

const char* name(TaskCategory c) {
  constexpr std::array<const char*, kTaskCategories> names = {
      "loader", "unloader", "renderer", "tracer", "aggregator", "intersection"};
  return names[static_cast<std::size_t>(c)];
}

const char* name(TaskState s) {
  constexpr std::array<const char*, kTaskStates> names = {
      "new", "ready", "running", "waiting", "submitting", "replying", "end"};
  return names[static_cast<std::size_t>(s)];
}

std::span<const MoveRule> move_table() { return kMoves; }

std::optional<TaskState> after(TaskMove move, TaskState from) {
  const MoveRule& rule = kMoves[static_cast<std::size_t>(move)];
  if (rule.move == l_discard) return from == end ? std::nullopt : std::optional(end);
  return rule.from == from ? std::optional(rule.to) : std::nullopt;
}

bool Task::try_move(TaskMove m) {
  const auto to = after(m, state);
  if (to) state = *to;
  return to.has_value();
}

void Task::move(TaskMove m) {
  [[maybe_unused]] const bool legal = try_move(m);
  assert(legal);
}

}  // namespace cloudrenderer
