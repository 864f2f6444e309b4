// Lists the loops of one instruction set.
#include "bare_loops.h"

namespace volsplat::VOLSPLAT_PATH {

extern constinit const BareLoops kBareLoops = {.splat = bare_splat, .shade = bare_shade};

}  // namespace volsplat::VOLSPLAT_PATH
