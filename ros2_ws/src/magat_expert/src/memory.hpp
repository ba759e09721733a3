// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cstddef>
#include <exception>
#include <memory_resource>

namespace magat_expert {

/// A search needs more memory than it may take.
struct MemoryLimitReached : std::exception {
  const char* what() const noexcept override { return "the memory limit is reached"; }
};

/// The memory of one search: counts the bytes of its containers. Not for several threads.
class Memory : public std::pmr::memory_resource {
 public:
  explicit Memory(std::size_t limit) : limit_(limit) {}

  /// Throws MemoryLimitReached if `bytes` more would exceed the limit.
  void require(std::size_t bytes) const {
    if (bytes > limit_ - used_) {
      throw MemoryLimitReached();
    }
  }

 private:
  void* do_allocate(std::size_t bytes, std::size_t alignment) override {
    require(bytes);
    void* const place = upstream_->allocate(bytes, alignment);
    used_ += bytes;
    return place;
  }
  void do_deallocate(void* place, std::size_t bytes, std::size_t alignment) override {
    upstream_->deallocate(place, bytes, alignment);
    used_ -= bytes;
  }
  bool do_is_equal(const std::pmr::memory_resource& other) const noexcept override { return this == &other; }

  std::pmr::memory_resource* upstream_ = std::pmr::new_delete_resource();
  std::size_t limit_;
  std::size_t used_ = 0;
};

}  // namespace magat_expert
