// Stage 8 at the level of pixels where nothing in the scene is glossy.
#define BY_CELLS
#define DIFFUSE_ONLY
#include "interpolate.frag"
