// Splats into an image, in stripes of rows where threads can share them.
#pragma once
#include "image_memory.h"
#include "splat_job.h"
#include "stripe_pool.h"

namespace volsplat {

// `job` says what and how; the image and its rows are filled in here. Without a pool all is done by the caller.
void splat_into(ImageMemory& image, SplatJob job, StripePool* pool);

}  // namespace volsplat
