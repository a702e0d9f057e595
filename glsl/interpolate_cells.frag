// Stage 8 at the level of pixels.
#define BY_CELLS
#include "interpolate.frag"
