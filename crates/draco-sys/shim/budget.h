// A ceiling on what one thread may hold on the C++ heap while it decodes.
#ifndef STEADYMESH_DRACO_BUDGET_H_
#define STEADYMESH_DRACO_BUDGET_H_

#include <cstddef>

namespace steadymesh {

// While one of these lives, this thread's `operator new` throws std::bad_alloc
// once more than `limit` bytes would be held. Not nestable.
class BudgetScope {
 public:
  explicit BudgetScope(size_t limit) noexcept;
  ~BudgetScope() noexcept;
  BudgetScope(const BudgetScope &) = delete;
  BudgetScope &operator=(const BudgetScope &) = delete;
};

}  // namespace steadymesh

#endif  // STEADYMESH_DRACO_BUDGET_H_
