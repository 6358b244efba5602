// Turns exceptions and draco::Status into SteadymeshDracoStatus.
#ifndef STEADYMESH_DRACO_STATUS_H_
#define STEADYMESH_DRACO_STATUS_H_

#include <cstring>
#include <exception>
#include <new>

#include "shim.h"

namespace steadymesh {

inline void Report(SteadymeshDracoStatus *status, SteadymeshDracoCode code,
                   const char *message) noexcept {
  status->code = code;
  std::strncpy(status->message, message, sizeof(status->message) - 1);
  status->message[sizeof(status->message) - 1] = '\0';
}

// Runs `body`, which reports its own refusals; whatever it throws is reported here.
template <typename Body>
void Guard(SteadymeshDracoStatus *status, Body body) noexcept {
  Report(status, STEADYMESH_DRACO_OK, "");
  try {
    body();
  } catch (const std::bad_alloc &) {
    Report(status, STEADYMESH_DRACO_OVER_BUDGET, "out of memory");
  } catch (const std::exception &error) {
    Report(status, STEADYMESH_DRACO_INTERNAL, error.what());
  } catch (...) {
    Report(status, STEADYMESH_DRACO_INTERNAL, "unknown C++ exception");
  }
}

}  // namespace steadymesh

#endif  // STEADYMESH_DRACO_STATUS_H_
