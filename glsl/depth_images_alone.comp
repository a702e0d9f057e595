// The same where a thread draws an image.
#define ALONE
#include "depth_images.comp"
