// The threads that own regions of an image: they live as long as the process draws, and share nothing while a frame
// runs.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "splat_frame.h"

namespace volsplat {

struct PixelMemory {  // or none
    std::shared_ptr<float[]> pixels;
    std::size_t floats;
};

// One thread at a time may call.
class Owners {
public:
    explicit Owners(int threads) : threads_(threads) {}
    ~Owners() { close(); }
    int threads() const { return threads_; }

    // Ends the frame before, and empties the image. Throws std::bad_alloc.
    void clear(int width, int height, bool turned);
    const std::shared_ptr<ImageMemory>& image() const { return image_; }
    // Begins a frame on the image, which must be clear, to be published into the memory if some is given. Throws
    // std::system_error if a thread cannot be started, and std::invalid_argument for regions that do not follow each
    // other within the image, and for memory of another size.
    std::shared_ptr<SplatFrame> begin(FrameTask task, PixelMemory published, std::shared_ptr<Bell> news,
                                      std::shared_ptr<Bell> all_wait);
    // Splats nothing more of the frame, which stays as it is.
    void cancel();
    // A block of memory for a part of the image.
    std::shared_ptr<float[]> free_block(const Rectangle& rectangle) { return blocks_.free_block(rectangle.floats()); }
    // Ends the threads, and gives up the frame and the image.
    void close();

private:
    void start(std::size_t threads);
    void work(int number, Bell& bell);
    void set_frame(std::shared_ptr<SplatFrame> frame);

    const int threads_;
    std::shared_ptr<ImageMemory> image_;
    ImageBlocks blocks_;
    std::vector<std::shared_ptr<Bell>> bells_;
    std::vector<std::thread> owners_;

    std::mutex mutex_;  // guards what follows
    std::condition_variable all_left_;
    std::shared_ptr<SplatFrame> frame_;
    int at_work_ = 0;
    bool closed_ = false;
};

}  // namespace volsplat
