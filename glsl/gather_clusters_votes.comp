// The same where a workgroup is a subgroup that can vote.
#define VOTES
#include "gather_clusters.comp"
