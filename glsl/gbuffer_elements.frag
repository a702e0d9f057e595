// Stage 1 where caches are interpolated: also which triangle a pixel shows.
#define ELEMENTS
#include "gbuffer.frag"
