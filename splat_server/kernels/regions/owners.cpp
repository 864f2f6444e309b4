#include "owners.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace volsplat {

namespace {

void check(const FrameTask& task, const ImageMemory& image) {
    if (task.regions.empty()) throw std::invalid_argument("a frame needs a region");
    const auto between_tiles = [&](int line) { return line % kTileSide == 0 || line == image.lines(); };
    int end = task.regions.front().begin;
    for (const RowSpan& lines : task.regions) {
        if (lines.begin != end || lines.begin < 0 || lines.end < lines.begin || lines.end > image.lines() ||
            !between_tiles(lines.begin) || !between_tiles(lines.end))
            throw std::invalid_argument("the regions do not follow each other within the image");
        end = lines.end;
    }
    if (task.walks.empty() ? task.sources < 0 : task.sources != 0 || task.walks.size() != task.regions.size())
        throw std::invalid_argument("a frame has sources, or a walk for each region");
    for (const EdgeLayer* layer : {task.layers.front, task.layers.behind})
        if (layer && (layer->width() != image.width() || layer->height() != image.height()))
            throw std::invalid_argument("the edge layers and the image differ in size");
}

}  // namespace

void Owners::clear(int width, int height, bool turned) {
    cancel();
    if (frame_) frame_->drop();
    set_frame(nullptr);
    if (!image_ || image_->width() != width || image_->height() != height) {
        image_.reset();
        image_ = std::make_shared<ImageMemory>(width, height);
    }
    image_->lay_out(turned);
}

std::shared_ptr<SplatFrame> Owners::begin(FrameTask task, PixelMemory published, std::shared_ptr<Bell> news,
                                          std::shared_ptr<Bell> all_wait) {
    if (frame_ || !image_) throw std::invalid_argument("the image is not clear");
    check(task, *image_);
    const Rectangle rectangle = rectangle_of(*image_, {task.regions.front().begin, task.regions.back().end});
    if (published.pixels && published.floats != rectangle.floats())
        throw std::invalid_argument("the memory to publish in has another size than the regions");
    start(std::min<std::size_t>(task.regions.size(), threads_));
    auto block = published.pixels ? std::move(published.pixels) : free_block(rectangle);
    const auto frame = std::make_shared<SplatFrame>(std::move(task), image_, std::move(block),
                                                    FrameBells{bells_, std::move(news), std::move(all_wait)});
    set_frame(frame);
    for (const auto& bell : bells_) bell->ring();
    return frame;
}

void Owners::set_frame(std::shared_ptr<SplatFrame> frame) {
    const std::lock_guard lock(mutex_);
    frame_.swap(frame);
}

void Owners::start(std::size_t threads) {
    while (owners_.size() < threads) {
        const auto bell = std::make_shared<Bell>();
        owners_.emplace_back([this, number = static_cast<int>(owners_.size()), bell] { work(number, *bell); });
        bells_.push_back(bell);
    }
}

void Owners::cancel() {
    std::unique_lock lock(mutex_);
    if (frame_) frame_->stop();
    all_left_.wait(lock, [&] { return at_work_ == 0; });
    if (frame_) frame_->let_go();
}

void Owners::close() {
    cancel();
    {
        const std::lock_guard lock(mutex_);
        closed_ = true;
    }
    for (const auto& bell : bells_) bell->ring();
    for (std::thread& owner : owners_) owner.join();
    owners_.clear();
    bells_.clear();
    if (frame_) frame_->drop();
    set_frame(nullptr);
    image_.reset();
    blocks_ = {};
}

void Owners::work(int number, Bell& bell) {
    for (std::uint64_t heard = 0;; heard = bell.wait(heard)) {
        std::shared_ptr<SplatFrame> frame;
        {
            const std::lock_guard lock(mutex_);
            if (closed_) return;
            frame = frame_;
            ++at_work_;
        }
        try {
            while (frame && frame->proceed(number)) continue;
        } catch (...) {
            frame->fail(std::current_exception());
        }
        frame.reset();
        const std::lock_guard lock(mutex_);
        if (--at_work_ == 0) all_left_.notify_all();
    }
}

}  // namespace volsplat
