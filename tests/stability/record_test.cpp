#include "record.h"

namespace cloudrenderer::stability {
namespace {

// What the script's own test looks for.
TEST(Record, MakesARow) { record("a row of a table", "nothing", 1, 0.5, 1); }

}  // namespace
}  // namespace cloudrenderer::stability
