// Stage 6 where caches light caches, too.
#define BOUNCES
#include "proxies.comp"
