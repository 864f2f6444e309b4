// Signs of life that go out though a library holds the interpreter: made ready before, sent by a thread of its own.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace volsplat {

class SignsOfLife {
public:
    // One of `signs` goes over the socket every so many seconds, the first after that time, until they are used up; it
    // is left for later while the socket has no room. Nobody else may send before take_back(). Throws
    // std::system_error if the system has no descriptor or no thread left.
    SignsOfLife(int socket, std::vector<std::string> signs, double seconds);
    ~SignsOfLife();
    SignsOfLife(const SignsOfLife&) = delete;
    SignsOfLife& operator=(const SignsOfLife&) = delete;

    // How many have not gone.
    std::size_t left();
    // Sends no more. What has not gone, in order; it may begin amid a sign.
    std::string take_back();

private:
    void send_all();
    bool send_next();
    void end();

    const int socket_;  // of our own: the caller may close its one at any time
    const std::chrono::duration<double> interval_;
    std::mutex mutex_;  // guards what follows
    std::condition_variable ended_;
    std::vector<std::string> signs_;
    std::size_t next_ = 0;
    std::size_t gone_ = 0;  // bytes of the next one
    bool over_ = false;
    std::thread thread_;
};

}  // namespace volsplat
