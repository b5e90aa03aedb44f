// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace deform::server {

/// Work of several clients, of which each gets an equal share of the work, not of the pieces: next is the piece that would be
/// over first if all clients were served at once at equal speed (weighted fair queueing: Demers, Keshav and Shenker 1989). So a
/// small piece does not wait for the large ones of others, and a large one no longer than its share takes. Not thread-safe.
template <typename Work>
class FairQueue {
 public:
  /// `owner` is what remove() names. The cost is in any unit, the same for all.
  void push(const std::string& name, const void* owner, double cost, Work work) {
    Client& client = clients_[name];
    const double begin = std::max(time_, client.end);
    client.end = begin + cost;
    client.pieces.push_back({owner, cost, begin, std::move(work)});
  }

  /// False if nothing waits.
  bool pop(Work& work) {
    Client* next = nullptr;
    const auto end_of = [](const Client& client) { return client.pieces.front().begin + client.pieces.front().cost; };
    for (auto it = clients_.begin(); it != clients_.end();) {
      if (it->second.pieces.empty()) {
        it = it->second.end <= time_ ? clients_.erase(it) : std::next(it);
        continue;
      }
      if (next == nullptr || end_of(it->second) < end_of(*next)) next = &it->second;
      ++it;
    }
    if (next == nullptr) return false;
    // As if each of those who are not through yet, were all served at once, got its share of this piece. What is done while
    // nobody else is there is held against no one.
    Piece& piece = next->pieces.front();
    time_ = std::max(time_ + piece.cost / static_cast<double>(clients_.size()), piece.begin);
    work = std::move(piece.work);
    next->pieces.pop_front();
    return true;
  }

  bool empty() const {
    return std::all_of(clients_.begin(), clients_.end(), [](const auto& each) { return each.second.pieces.empty(); });
  }

  /// What waits of that owner, taken out: to be destroyed without the lock of whoever calls, as it may own what calls back.
  std::vector<Work> remove(const void* owner) {
    std::vector<Work> removed;
    for (auto& [name, client] : clients_) {
      for (auto it = client.pieces.begin(); it != client.pieces.end();) {
        if (it->owner != owner) {
          ++it;
          continue;
        }
        client.end -= it->cost;
        removed.push_back(std::move(it->work));
        it = client.pieces.erase(it);
      }
    }
    return removed;
  }

 private:
  struct Piece {
    const void* owner;
    double cost;
    double begin;  ///< virtual time at which it would begin; it would end at begin + cost
    Work work;
  };
  struct Client {
    std::deque<Piece> pieces;
    double end = 0;  ///< virtual time at which the last of its pieces would be over
  };
  std::map<std::string, Client> clients_;  ///< those with pieces that wait, and those who had more than their share
  double time_ = 0;                        ///< what a client that always waited would have got by now
};

}  // namespace deform::server
