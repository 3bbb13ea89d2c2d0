// Nodes for BehaviorTree.CPP 4 that keep the meaning of islandgp's trees.
//
//     #include "islandgp_nodes.hpp"
//     BT::BehaviorTreeFactory factory;
//     islandgp::register_nodes(factory);  // before the XML is loaded
//
// The library's own Reactive nodes start an interrupting branch before they halt
// the branch that it interrupts, interrupt whenever a condition *is* true, and
// take a running branch up again when the interrupting one fails. These nodes halt
// first and interrupt when a condition *turns* true. What each does in a tick is
// told in islandgp's docs/semantics.md.
//
// One tick is one call of Tree::tickExactlyOnce(). No node here emits a wake-up
// signal, so that Tree::tickOnce() does the same unless a leaf emits one.
//
// A leaf that is skipped (_skipIf) counts as one that hands over to the next
// branch; a parallel and a repetition count it as a success.

#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <behaviortree_cpp/bt_factory.h>

namespace islandgp
{

/// A guard: runs its child while a blackboard entry and a number are in a relation.
///
/// Attributes, read once when the tree is made:
///   key     the name of a blackboard entry that is a number or a bool
///   op      < <= > >= == != for a number; is, not for a bool
///   number  what the entry is compared with
///   abort   none: asked at the start only; self: also in each tick; lower: interrupts later
///           branches of the nearest InterruptibleFallback or -Sequence; both: the last two
class When : public BT::DecoratorNode
{
public:
  When(const std::string& name, const BT::NodeConfig& config)
    : BT::DecoratorNode(name, config), key_(read<std::string>("key")), number_(read<double>("number"))
  {
    const auto op = read<std::string>("op");
    const auto abort = read<std::string>("abort");
    if(op == "<") compare_ = std::less<double>();
    else if(op == "<=") compare_ = std::less_equal<double>();
    else if(op == ">") compare_ = std::greater<double>();
    else if(op == ">=") compare_ = std::greater_equal<double>();
    else if(op == "==" || op == "not") compare_ = std::equal_to<double>();
    else if(op == "!=" || op == "is") compare_ = std::not_equal_to<double>();
    else throw BT::RuntimeError("When: expected op < <= > >= == != is or not, found ", op);
    if(abort != "none" && abort != "self" && abort != "lower" && abort != "both")
    {
      throw BT::RuntimeError("When: expected abort none, self, lower or both, found ", abort);
    }
    stops_itself_ = abort == "self" || abort == "both";
    interrupts_ = abort == "lower" || abort == "both";
  }

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<std::string>("key", "name of a blackboard entry"),
             BT::InputPort<std::string>("op", "is", "relation of the entry and the number"),
             BT::InputPort<double>("number", 0.0, "what the entry is compared with"),
             BT::InputPort<std::string>("abort", "both", "none, self, lower or both") };
  }

  /// Whether the condition holds now.
  bool holds() const
  {
    const auto entry = config().blackboard->getAnyLocked(key_);
    if(!entry || entry->empty())
    {
      throw BT::RuntimeError("When: the blackboard has no entry ", key_,
                             "; set it before the first tick");
    }
    return compare_(entry->cast<double>(), number_);
  }

  bool interrupts() const
  {
    return interrupts_;
  }

  /// What the condition was when it was asked last; nothing: not asked since the composite started.
  std::optional<bool> seen;

private:
  BT::NodeStatus tick() override
  {
    if(status() != BT::NodeStatus::RUNNING)
    {
      seen = holds();
      if(!*seen)
      {
        return BT::NodeStatus::FAILURE;
      }
    }
    else if(stops_itself_ && !holds())
    {
      resetChild();
      return BT::NodeStatus::FAILURE;
    }
    setStatus(BT::NodeStatus::RUNNING);
    const auto result = child_node_->executeTick();
    if(result != BT::NodeStatus::RUNNING)
    {
      resetChild();
    }
    return result;
  }

  template <typename T>
  T read(const std::string& port)
  {
    const auto found = getInput<T>(port);
    if(!found)
    {
      throw BT::RuntimeError("When: expected the attribute ", port, ": ", found.error());
    }
    return found.value();
  }

  std::string key_;
  double number_;
  std::function<bool(double, double)> compare_;
  bool stops_itself_ = false;
  bool interrupts_ = false;
};

/// A Fallback or Sequence with memory that goes back to an earlier branch when a guard in front
/// of that branch turns true. The branch that ran is halted before the other one starts.
///
/// `HandsOver` is the status with which it goes on to the next branch.
template <BT::NodeStatus HandsOver>
class Interruptible : public BT::ControlNode
{
public:
  Interruptible(const std::string& name, const BT::NodeConfig& config)
    : BT::ControlNode(name, config)
  {}

  static BT::PortsList providedPorts()
  {
    return {};
  }

private:
  struct Guard
  {
    std::size_t branch;
    When* when;
  };

  BT::NodeStatus tick() override
  {
    if(guards_.empty())
    {
      collect();
    }
    std::size_t at = 0;
    bool fresh = status() != BT::NodeStatus::RUNNING;
    if(fresh)
    {
      forget(0);
      all_skipped_ = true;
    }
    else
    {
      at = turned_true();
      if(at != current_)
      {
        haltChild(current_);
        forget(at);
        fresh = true;
      }
    }
    setStatus(BT::NodeStatus::RUNNING);
    auto result = children_nodes_[at]->executeTick();
    if(hands_over(result) && !fresh)
    {
      // From now on the guards of this branch are observed, and what they were when the branch
      // started may be long ago.
      for(const auto& guard : guards_)
      {
        if(guard.branch == at && guard.when->seen)
        {
          guard.when->seen = guard.when->holds();
        }
      }
    }
    while(hands_over(result))
    {
      haltChild(at);  // finished: ready for a new start
      if(++at == children_nodes_.size())
      {
        resetChildren();
        return all_skipped_ ? BT::NodeStatus::SKIPPED : HandsOver;
      }
      result = children_nodes_[at]->executeTick();
    }
    all_skipped_ = false;
    current_ = at;
    if(result != BT::NodeStatus::RUNNING)
    {
      resetChildren();
    }
    return result;
  }

  bool hands_over(BT::NodeStatus result)
  {
    if(result == HandsOver)
    {
      all_skipped_ = false;
    }
    return result == HandsOver || result == BT::NodeStatus::SKIPPED;
  }

  /// The guards of all branches but the last, down to the first node that is no decorator.
  void collect()
  {
    for(std::size_t branch = 0; branch + 1 < children_nodes_.size(); branch++)
    {
      auto* node = dynamic_cast<BT::DecoratorNode*>(children_nodes_[branch]);
      while(node != nullptr)
      {
        if(auto* when = dynamic_cast<When*>(node); when != nullptr && when->interrupts())
        {
          guards_.push_back({ branch, when });
        }
        node = dynamic_cast<BT::DecoratorNode*>(node->child());
      }
    }
  }

  /// The guards of that branch and of later ones are not observed until they are asked again.
  void forget(std::size_t branch)
  {
    for(const auto& guard : guards_)
    {
      if(guard.branch >= branch)
      {
        guard.when->seen.reset();
      }
    }
  }

  /// The branch of the first observed guard that turned true, else the running branch.
  std::size_t turned_true()
  {
    for(const auto& guard : guards_)
    {
      if(guard.branch >= current_)
      {
        break;
      }
      if(guard.when->seen)
      {
        const bool before = *guard.when->seen;
        guard.when->seen = guard.when->holds();
        if(*guard.when->seen && !before)
        {
          return guard.branch;
        }
      }
    }
    return current_;
  }

  std::vector<Guard> guards_;
  std::size_t current_ = 0;
  bool all_skipped_ = true;
};

using InterruptibleFallback = Interruptible<BT::NodeStatus::FAILURE>;
using InterruptibleSequence = Interruptible<BT::NodeStatus::SUCCESS>;

/// Ticks every child that is not finished, and judges afterwards, failures first.
///
/// Attributes: success and failure, each one or all: how many children decide.
class JudgedParallel : public BT::ControlNode
{
public:
  JudgedParallel(const std::string& name, const BT::NodeConfig& config)
    : BT::ControlNode(name, config), success_one_(one("success")), failure_one_(one("failure"))
  {}

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<std::string>("success", "all", "how many must succeed: one or all"),
             BT::InputPort<std::string>("failure", "one", "how many must fail: one or all") };
  }

private:
  BT::NodeStatus tick() override
  {
    const std::size_t count = children_nodes_.size();
    if(status() != BT::NodeStatus::RUNNING)
    {
      results_.assign(count, BT::NodeStatus::RUNNING);
    }
    setStatus(BT::NodeStatus::RUNNING);
    std::size_t succeeded = 0;
    std::size_t failed = 0;
    for(std::size_t at = 0; at < count; at++)
    {
      if(results_[at] == BT::NodeStatus::RUNNING)
      {
        results_[at] = children_nodes_[at]->executeTick();
        if(results_[at] != BT::NodeStatus::RUNNING)
        {
          haltChild(at);  // finished: ready for a new start
        }
      }
      failed += results_[at] == BT::NodeStatus::FAILURE;
      succeeded += results_[at] == BT::NodeStatus::SUCCESS || results_[at] == BT::NodeStatus::SKIPPED;
    }
    const bool fails = failed >= (failure_one_ ? 1 : count);
    const bool succeeds = succeeded >= (success_one_ ? 1 : count);
    if(!fails && !succeeds && succeeded + failed < count)
    {
      return BT::NodeStatus::RUNNING;
    }
    resetChildren();
    return succeeds && !fails ? BT::NodeStatus::SUCCESS : BT::NodeStatus::FAILURE;
  }

  bool one(const std::string& port)
  {
    const auto found = getInput<std::string>(port);
    if(!found || (found.value() != "one" && found.value() != "all"))
    {
      throw BT::RuntimeError("JudgedParallel: expected one or all as the attribute ", port);
    }
    return found.value() == "one";
  }

  bool success_one_;
  bool failure_one_;
  std::vector<BT::NodeStatus> results_;
};

/// Does one repetition a tick, until its child has succeeded num_cycles times. Fails with its child.
class RepeatPerTick : public BT::DecoratorNode
{
public:
  RepeatPerTick(const std::string& name, const BT::NodeConfig& config)
    : BT::DecoratorNode(name, config)
  {
    const auto found = getInput<int>("num_cycles");
    if(!found || found.value() < 1)
    {
      throw BT::RuntimeError("RepeatPerTick: expected num_cycles of at least 1");
    }
    count_ = found.value();
  }

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<int>("num_cycles", "successes of the child that are needed") };
  }

private:
  BT::NodeStatus tick() override
  {
    if(status() != BT::NodeStatus::RUNNING)
    {
      left_ = count_;
    }
    setStatus(BT::NodeStatus::RUNNING);
    const auto result = child_node_->executeTick();
    if(result == BT::NodeStatus::RUNNING)
    {
      return result;
    }
    resetChild();
    if(result == BT::NodeStatus::FAILURE)
    {
      return result;
    }
    return --left_ == 0 ? BT::NodeStatus::SUCCESS : BT::NodeStatus::RUNNING;
  }

  int count_ = 1;
  int left_ = 1;  // successes still to come
};

/// Makes the nodes known to a factory, under the names of the classes.
inline void register_nodes(BT::BehaviorTreeFactory& factory)
{
  factory.registerNodeType<When>("When");
  factory.registerNodeType<InterruptibleFallback>("InterruptibleFallback");
  factory.registerNodeType<InterruptibleSequence>("InterruptibleSequence");
  factory.registerNodeType<JudgedParallel>("JudgedParallel");
  factory.registerNodeType<RepeatPerTick>("RepeatPerTick");
}

}  // namespace islandgp
