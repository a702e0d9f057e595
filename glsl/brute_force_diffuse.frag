// Brute force where nothing in the scene is glossy.
#define DIFFUSE_ONLY
#include "brute_force.frag"
