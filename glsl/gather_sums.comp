// Stage 6, compute path, the sums alone.
#define SUMS_ALONE
#include "gather.comp"
