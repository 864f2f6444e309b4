#include "signs_of_life.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

namespace volsplat {

namespace {

#ifdef MSG_NOSIGNAL
constexpr int FLAGS = MSG_DONTWAIT | MSG_NOSIGNAL;
#else  // Python ignores SIGPIPE
constexpr int FLAGS = MSG_DONTWAIT;
#endif

int duplicate(int socket) {
    const int own = fcntl(socket, F_DUPFD_CLOEXEC, 0);
    if (own < 0) throw std::system_error(errno, std::generic_category());
    return own;
}

}  // namespace

SignsOfLife::SignsOfLife(int socket, std::vector<std::string> signs, double seconds)
    : socket_(duplicate(socket)), interval_(seconds), signs_(std::move(signs)) {
    try {
        thread_ = std::thread([this] { send_all(); });
    } catch (...) {
        close(socket_);
        throw;
    }
}

SignsOfLife::~SignsOfLife() {
    end();
    close(socket_);
}

std::size_t SignsOfLife::left() {
    const std::lock_guard lock(mutex_);
    return over_ ? 0 : signs_.size() - next_;
}

std::string SignsOfLife::take_back() {
    end();
    std::string rest;
    for (; next_ < signs_.size(); ++next_, gone_ = 0) rest += signs_[next_].substr(gone_);
    return rest;
}

void SignsOfLife::end() {
    {
        const std::lock_guard lock(mutex_);
        over_ = true;
    }
    ended_.notify_all();
    if (thread_.joinable()) thread_.join();
}

void SignsOfLife::send_all() {
    std::unique_lock lock(mutex_);
    while (!ended_.wait_for(lock, interval_, [this] { return over_; }))
        if (next_ == signs_.size() || !send_next()) return;
}

// False if the connection is gone, which whoever receives is told by the system.
bool SignsOfLife::send_next() {
    const std::string& sign = signs_[next_];
    const ssize_t count = send(socket_, sign.data() + gone_, sign.size() - gone_, FLAGS);
    if (count < 0) return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR || errno == ENOBUFS;
    gone_ += static_cast<std::size_t>(count);
    if (gone_ == sign.size()) ++next_, gone_ = 0;
    return true;
}

}  // namespace volsplat
