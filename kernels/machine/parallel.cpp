#include "machine/parallel.hpp"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "machine/processor.hpp"

namespace ringlight {
namespace {

constexpr std::chrono::microseconds PATIENCE{100};  // a little more than the usual gap between two loops of one step
constexpr int MOST_THREADS = 1024;  // more than any machine has cores: a slip of the keyboard must not pass

int cores() {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof set, &set) == 0) return CPU_COUNT(&set);
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));  // 0 where it is not known
}

// Waiting without sleep, for a while: a thread that sleeps takes longer to wake up than most gaps last. By the clock,
// since one pause lasts 10 to 140 cycles, depending on the processor.
class Spin {
 public:
  // False when patience is at its end.
  bool once() {
    constexpr int PAUSES = 64;  // between two looks at the clock
    relax();
    if (++pauses_ % PAUSES) return true;
    const auto now = std::chrono::steady_clock::now();
    if (pauses_ == PAUSES) end_ = now + PATIENCE;
    return now < end_;
  }

 private:
  unsigned pauses_ = 0;
  std::chrono::steady_clock::time_point end_;
};

struct Loop {
  detail::Body body = nullptr;
  void* closure = nullptr;
  std::size_t pieces = 0;
  std::atomic<std::size_t> next{0};
  std::atomic<bool> failed{false};
  std::exception_ptr failure;  // of the piece that set `failed`

  // No exception leaves a worker, where it would end the process, nor the caller before the workers are out.
  void work() noexcept {
    FlushToZero mode;
    try {
      for (std::size_t i; (i = next.fetch_add(1, std::memory_order_relaxed)) < pieces;) body(closure, i);
    } catch (...) {
      next.store(pieces);
      if (!failed.exchange(true)) failure = std::current_exception();
    }
  }

  // When all who worked are done.
  void rethrow() {
    if (failed.exchange(false)) std::rethrow_exception(std::exchange(failure, nullptr));
  }
};

// One loop at a time. `state_` holds OPEN while a loop accepts workers, plus the number of workers inside it; the
// caller closes the loop when the pieces are used up and waits only for workers that did get in.
class Pool {
 public:
  // With fewer threads than asked for where the system gives no more: slower, and otherwise the same.
  explicit Pool(int workers) : workers_(workers) {
    threads_.reserve(static_cast<std::size_t>(workers));
    try {
      for (int i = 0; i < workers; i++) threads_.emplace_back([this] { serve(); });
    } catch (const std::system_error&) {
    }
  }

  ~Pool() {
    stopping_ = true;
    generation_.fetch_add(1);
    generation_.notify_all();
    for (auto& thread : threads_) thread.join();
  }

  int workers() const { return workers_; }

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
    for (Spin spin; state_.load(std::memory_order_acquire) != 0;)
      if (!spin.once()) std::this_thread::yield();
    loop_.rethrow();
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
      for (Spin spin; generation_.load(std::memory_order_acquire) == seen;)
        if (!spin.once()) generation_.wait(seen);
      seen = generation_.load();
      if (stopping_) return;
      if (!enter()) continue;
      loop_.work();
      state_.fetch_sub(1);
    }
  }

  const int workers_;
  std::vector<std::thread> threads_;
  Loop loop_;
  std::atomic<unsigned> generation_{0};
  std::atomic<int> state_{0};
  std::atomic<bool> stopping_{false};
};

std::mutex guard;  // one parallel loop at a time per process
Pool* pool = nullptr;  // never deleted when the process ends: its threads may still spin then
std::atomic<int> wanted{0};

// A forked child has no workers: drop the parent's pool (leaked on purpose, its threads do not exist here).
void forget_pool() {
  pool = nullptr;
  new (&guard) std::mutex;
}
[[maybe_unused]] const int registered = pthread_atfork(nullptr, nullptr, forget_pool);

Pool& current_pool() {
  const int workers = threads() - 1;
  if (pool && pool->workers() != workers) {
    delete pool;
    pool = nullptr;
  }
  if (!pool) pool = new Pool(workers);
  return *pool;
}

}  // namespace

void set_threads(int count) { wanted = count; }

int threads() {
  const int count = wanted;
  return std::min(count > 0 ? count : cores(), MOST_THREADS);
}

void detail::run(std::size_t pieces, Body body, void* closure) {
  if (pieces == 0) return;
  const std::lock_guard lock(guard);
  if (pieces == 1 || threads() == 1) {
    Loop loop;
    loop.body = body;
    loop.closure = closure;
    loop.pieces = pieces;
    loop.work();
    loop.rethrow();
    return;
  }
  current_pool().run(pieces, body, closure);
}

}  // namespace ringlight
