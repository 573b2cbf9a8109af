/* Preconditions of internal functions, asserted in debug builds only (-DKERNEL_DEBUG): tests/unit/test_kernel.py runs
 * hostile arrays with them, .ci/sanitize the tests of the kernel. */
#ifndef CONFLICTDB_REQUIRE_H
#define CONFLICTDB_REQUIRE_H

#ifdef KERNEL_DEBUG
#undef NDEBUG
#include <assert.h>
#define REQUIRE(condition) assert(condition)
#else
#define REQUIRE(condition) ((void)0)
#endif

#endif
