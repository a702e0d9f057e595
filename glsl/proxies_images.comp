// Stage 6 after the fragment path.
#define FROM_IMAGES
#include "proxies.comp"
