// Stage 6, compute path, the sums alone, where things are in the way of indirect light.
#define SUMS_ALONE
#include "gather_shadowed.comp"
