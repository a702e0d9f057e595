// Stage 7 where no list says which caches are live: those that are not are unlit.
#define ALL
#include "occlude.comp"
