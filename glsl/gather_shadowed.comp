// Stage 6, compute path, where things are in the way of indirect light.
#define SHADOWED
#include "gather.comp"
