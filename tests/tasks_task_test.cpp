#include "tasks/task.h"

#include <gtest/gtest.h>

#include <string>

namespace cloudrenderer {
namespace {

using enum TaskState;
using enum TaskMove;

// The table of design section 4, written a second time.
struct Expected {
  TaskMove move;
  TaskState from, to;
};
constexpr Expected kLegal[] = {
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
    {l_discard, fresh, end},
    {l_discard, ready, end},
    {l_discard, running, end},
    {l_discard, waiting, end},
    {l_discard, submitting, end},
    {l_discard, replying, end},
    {m_part_unloaded, ready, fresh},
    {n_load_first, fresh, waiting},
    {o_refused, waiting, fresh},
    {p_map_changed, submitting, fresh},
};

TEST(TaskMoves, AreLegalExactlyWhereTheDesignSaysSo) {
  for (std::size_t m = 0; m < kTaskMoves; ++m) {
    for (std::size_t s = 0; s < kTaskStates; ++s) {
      const auto move = static_cast<TaskMove>(m);
      const auto from = static_cast<TaskState>(s);
      std::optional<TaskState> expected;
      for (const Expected& e : kLegal)
        if (e.move == move && e.from == from) expected = e.to;
      EXPECT_EQ(after(move, from), expected)
          << "move " << static_cast<char>('a' + m) << " from " << name(from);
    }
  }
}

TEST(TaskMoves, TableListsEveryMoveOnceInOrder) {
  ASSERT_EQ(move_table().size(), kTaskMoves);
  for (std::size_t m = 0; m < kTaskMoves; ++m)
    EXPECT_EQ(move_table()[m].move, static_cast<TaskMove>(m));
}

TEST(Task, StaysWhereItIsWhenAMoveIsIllegal) {
  Task t;
  EXPECT_FALSE(t.try_move(h_collected));
  EXPECT_EQ(t.state, fresh);
  EXPECT_TRUE(t.try_move(d_delegate));
  EXPECT_EQ(t.state, submitting);
}

TEST(Task, NamesAreThoseOfTheReport) {
  EXPECT_STREQ(name(TaskCategory::intersection), "intersection");
  EXPECT_STREQ(name(fresh), "new");
}

}  // namespace
}  // namespace cloudrenderer
