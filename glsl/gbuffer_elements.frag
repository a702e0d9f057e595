// Stage 1 where caches are culled: also which triangle a pixel shows.
#define ELEMENTS
#include "gbuffer.frag"
