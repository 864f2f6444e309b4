// The interpreter's lock (GIL), let go and taken again; safe in a thread that still works while the interpreter ends.
//
// Until Python 3.14 a thread that asks for the lock then is ended by pthread_exit, which unwinds its stack: nanobind's
// guards cannot be unwound, and the process would abort in place of ending. Such a thread rests here until it ends.
#pragma once

#include <Python.h>

#include <chrono>
#include <thread>

namespace volsplat {

template <class Take>
void take_interpreter_lock(const Take& take) {
    try {
        take();
    } catch (...) {  // the stack's unwinding, which must go no further: C++ raises nothing in there
        while (true) std::this_thread::sleep_for(std::chrono::hours(1));
    }
}

// Without the lock, from having it.
class Unlocked {
public:
    Unlocked() : state_(PyEval_SaveThread()) {}
    ~Unlocked() {
        take_interpreter_lock([this] { PyEval_RestoreThread(state_); });
    }
    Unlocked(const Unlocked&) = delete;
    Unlocked& operator=(const Unlocked&) = delete;

private:
    PyThreadState* const state_;
};

// With the lock, in any thread.
class Locked {
public:
    Locked() {
        take_interpreter_lock([this] { state_ = PyGILState_Ensure(); });
    }
    ~Locked() { PyGILState_Release(state_); }
    Locked(const Locked&) = delete;
    Locked& operator=(const Locked&) = delete;

private:
    PyGILState_STATE state_;
};

}  // namespace volsplat
