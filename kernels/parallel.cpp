#include "parallel.hpp"

#include <immintrin.h>
#include <pthread.h>
#include <sched.h>

#include <atomic>
#include <mutex>
#include <thread>
#include <vector>

namespace ringlight {
namespace {

constexpr unsigned FLUSH_TO_ZERO = 0x8040;  // MXCSR: FTZ and DAZ; subnormal alphas cost a hundred cycles each
constexpr int SPINS = 4000;                 // about 50 us: the usual gap between two loops of one training step

int cores() {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof set, &set) == 0) return CPU_COUNT(&set);
  return static_cast<int>(std::thread::hardware_concurrency());
}

class FlushToZero {
 public:
  FlushToZero() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | FLUSH_TO_ZERO); }
  ~FlushToZero() { _mm_setcsr(saved_); }

 private:
  unsigned saved_;
};

struct Loop {
  detail::Body body = nullptr;
  void* closure = nullptr;
  std::size_t pieces = 0;
  std::atomic<std::size_t> next{0};

  void work() {
    FlushToZero mode;
    for (std::size_t i; (i = next.fetch_add(1, std::memory_order_relaxed)) < pieces;) body(closure, i);
  }
};

// One loop at a time. `state_` holds OPEN while a loop accepts workers, plus the number of workers inside it; the
// caller closes the loop when the pieces are used up and waits only for workers that did get in.
class Pool {
 public:
  explicit Pool(int workers) {
    for (int i = 0; i < workers; i++) threads_.emplace_back([this] { serve(); });
  }

  ~Pool() {
    stopping_ = true;
    generation_.fetch_add(1);
    generation_.notify_all();
    for (auto& thread : threads_) thread.join();
  }

  int workers() const { return static_cast<int>(threads_.size()); }

  void run(std::size_t pieces, detail::Body body, void* closure) {
    loop_.body = body;
    loop_.closure = closure;
    loop_.pieces = pieces;
    loop_.next.store(0);
    state_.store(OPEN);
    generation_.fetch_add(1);
    generation_.notify_all();
    loop_.work();
    state_.fetch_and(~OPEN);
    for (int spins = 0; state_.load(std::memory_order_acquire) != 0;) {
      if (++spins < SPINS) _mm_pause();
      else std::this_thread::yield();
    }
  }

 private:
  static constexpr int OPEN = 1 << 30;

  bool enter() {
    int state = state_.load();
    while (state & OPEN)
      if (state_.compare_exchange_weak(state, state + 1)) return true;
    return false;
  }

  void serve() {
    // Not generation_: a worker that starts after the last loop, or after the destructor, must notice that it is late.
    unsigned seen = 0;
    for (;;) {
      for (int spins = 0; generation_.load(std::memory_order_acquire) == seen;) {
        if (++spins < SPINS) _mm_pause();
        else generation_.wait(seen);
      }
      seen = generation_.load();
      if (stopping_) return;
      if (!enter()) continue;
      loop_.work();
      state_.fetch_sub(1);
    }
  }

  std::vector<std::thread> threads_;
  Loop loop_;
  std::atomic<unsigned> generation_{0};
  std::atomic<int> state_{0};
  std::atomic<bool> stopping_{false};
};

std::mutex guard;  // one parallel loop at a time per process
Pool* pool = nullptr;
int wanted = 0;

// A forked child has no workers: drop the parent's pool (leaked on purpose, its threads do not exist here).
void forget_pool() {
  pool = nullptr;
  new (&guard) std::mutex;
}

Pool& current_pool() {
  static const int registered = pthread_atfork(nullptr, nullptr, forget_pool);
  (void)registered;
  const int workers = threads() - 1;
  if (pool && pool->workers() != workers) {
    delete pool;
    pool = nullptr;
  }
  if (!pool) pool = new Pool(workers);
  return *pool;
}

}  // namespace

void set_threads(int count) {
  const std::lock_guard lock(guard);
  wanted = count;
}

int threads() { return wanted > 0 ? wanted : cores(); }

void detail::run(std::size_t pieces, Body body, void* closure) {
  if (pieces == 0) return;
  const std::lock_guard lock(guard);
  if (pieces == 1 || threads() == 1) {
    Loop loop;
    loop.body = body;
    loop.closure = closure;
    loop.pieces = pieces;
    loop.work();
    return;
  }
  current_pool().run(pieces, body, closure);
}

}  // namespace ringlight
