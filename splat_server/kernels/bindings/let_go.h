// Python objects that threads without the GIL have no use for any more.
#pragma once

#include <atomic>
#include <memory>
#include <utility>

namespace volsplat {

// Kept until somebody who holds the GIL comes by, so that no thread ever waits for it.
class LetGo {
public:
    template <class Kept>
    static std::shared_ptr<const void> later(Kept kept) {
        return std::shared_ptr<Node>(new Keeper<Kept>(std::move(kept)), &add);
    }

    // With the GIL.
    static void now() {
        Node* node = gone_.exchange(nullptr);
        while (node) delete std::exchange(node, node->next);
    }

private:
    struct Node {
        virtual ~Node() = default;
        Node* next = nullptr;
    };
    template <class Kept>
    struct Keeper : Node {
        explicit Keeper(Kept given) : kept(std::move(given)) {}
        Kept kept;
    };

    static void add(Node* node) {
        node->next = gone_.load();
        while (!gone_.compare_exchange_weak(node->next, node)) continue;
    }

    inline static std::atomic<Node*> gone_{nullptr};
};

}  // namespace volsplat
