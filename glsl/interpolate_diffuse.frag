// Stage 8 where nothing in the scene is glossy.
#define DIFFUSE_ONLY
#include "interpolate.frag"
