// Replaces the global allocation functions (as [new.delete] allows) so that a
// hostile file cannot make libdraco allocate gigabytes. libdraco must be linked
// statically for its calls to end here. Over-aligned forms are left alone:
// libdraco does not use them.
#include "budget.h"

#include <malloc.h>

#include <cstdint>
#include <cstdlib>
#include <new>

#include "shim.h"

namespace {

struct Budget {
  bool active;
  int64_t limit;
  // Can go below zero: memory from before the scope may be freed inside it.
  int64_t held;
  int64_t peak;
  size_t refused;
};

thread_local Budget budget = {false, 0, 0, 0, 0};

// Null if there is no memory or the budget forbids it.
void *Allocate(size_t size) noexcept {
  if (size == 0) {
    size = 1;
  }
  if (budget.active) {
    // The request counts in full before a page of it is touched.
    const int64_t room = budget.limit - budget.held;
    if (room < 0 || size > static_cast<uint64_t>(room)) {
      budget.refused = size;
      return nullptr;
    }
  }
  void *memory = std::malloc(size);
  if (memory != nullptr && budget.active) {
    budget.held += static_cast<int64_t>(malloc_usable_size(memory));
    if (budget.held > budget.peak) {
      budget.peak = budget.held;
    }
  }
  return memory;
}

void *AllocateOrThrow(size_t size) {
  void *memory = Allocate(size);
  if (memory == nullptr) {
    throw std::bad_alloc();
  }
  return memory;
}

void Release(void *memory) noexcept {
  if (memory != nullptr && budget.active) {
    budget.held -= static_cast<int64_t>(malloc_usable_size(memory));
  }
  std::free(memory);
}

}  // namespace

namespace steadymesh {

BudgetScope::BudgetScope(size_t limit) noexcept {
  const int64_t ceiling = limit > INT64_MAX ? INT64_MAX : static_cast<int64_t>(limit);
  budget = {true, ceiling, 0, 0, 0};
}

BudgetScope::~BudgetScope() noexcept { budget.active = false; }

}  // namespace steadymesh

extern "C" size_t steadymesh_draco_last_peak() noexcept {
  return static_cast<size_t>(budget.peak);
}

extern "C" size_t steadymesh_draco_last_refused() noexcept { return budget.refused; }

void *operator new(size_t size) { return AllocateOrThrow(size); }
void *operator new[](size_t size) { return AllocateOrThrow(size); }
void *operator new(size_t size, const std::nothrow_t &) noexcept { return Allocate(size); }
void *operator new[](size_t size, const std::nothrow_t &) noexcept { return Allocate(size); }
void operator delete(void *memory) noexcept { Release(memory); }
void operator delete[](void *memory) noexcept { Release(memory); }
void operator delete(void *memory, size_t) noexcept { Release(memory); }
void operator delete[](void *memory, size_t) noexcept { Release(memory); }
void operator delete(void *memory, const std::nothrow_t &) noexcept { Release(memory); }
void operator delete[](void *memory, const std::nothrow_t &) noexcept { Release(memory); }
