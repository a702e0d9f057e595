// Stage 4, compaction, second pass, where no cache is culled: the gather's dispatch, too.
#define ARGS
#include "pack_vals.comp"
