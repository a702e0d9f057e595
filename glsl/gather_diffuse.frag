// Stage 6 where nothing in the scene is glossy.
#define DIFFUSE_ONLY
#include "gather.frag"
