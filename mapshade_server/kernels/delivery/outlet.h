// A walker's way to a splat server.
#pragma once

#include <cstddef>
#include <limits>
#include <memory>

#include "mapshade_server/kernels/batches/batch.h"

namespace volsplat {

// One thread at a time may call.
class Outlet {
public:
    virtual ~Outlet() = default;

    // To be called before each batch. Waits until the splat server is near enough to where the walker is, if that
    // matters; returns how many packets the batch should have at most.
    virtual std::size_t most_packets() { return std::numeric_limits<std::size_t>::max(); }

    // Sends what of a batch is for the splat server, or less once the frame is not wanted any more. False if the
    // splat server is lost.
    virtual bool send(const std::shared_ptr<Batch>& batch) = 0;
};

}  // namespace volsplat
