// Nodes for BehaviorTree.CPP 4 that keep the meaning of islandgp's trees.
//
//     #include "islandgp_nodes.hpp"
//     BT::BehaviorTreeFactory factory;
//     islandgp::register_nodes(factory, 0.1);  // before the XML is loaded; seconds between two ticks
//
// The library's own Reactive nodes start an interrupting branch before they halt
// the interrupted one, interrupt whenever a condition *is* true, and resume the
// running branch when the interrupting one fails. These nodes halt first and
// interrupt when a condition *becomes* true. islandgp's docs/semantics.md
// describes what each does in a tick.
//
// One tick is one call of Tree::tickExactlyOnce(). No node here emits a wake-up
// signal, so that Tree::tickOnce() does the same unless a leaf emits one.
//
// A skipped leaf (_skipIf) has the status after which its composite continues
// with the next branch; a parallel and a repetition count it as a success.

#pragma once

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <functional>
#include <locale>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <behaviortree_cpp/bt_factory.h>

namespace islandgp
{

/// A condition as in a tree: `battery < 25 and not (found or lap >= 3)`.
///
/// Keys are names of blackboard entries; `not` binds most, then `and`, then `or`. A number is
/// compared exactly, with a number or another entry; a text with a word, as in `mode == 'idle'`.
class Condition
{
public:
  using Read = std::function<BT::Any(const std::string& key)>;

  explicit Condition(const std::string& text) : text_(text), whole_(condition(joined("or")))
  {
    if(!word().empty())
    {
      fail();
    }
  }

  bool holds(const Read& read) const
  {
    return holds(whole_, read);
  }

private:
  struct Part
  {
    std::string word;  // and, or, not, an operator, + - * /, key, text or number
    std::string text;  // the name of the key, or the text
    double number;
    std::vector<Part> parts;
  };

  static bool holds(const Part& part, const Read& read)
  {
    if(part.word == "not")
    {
      return !holds(part.parts[0], read);
    }
    if(part.word == "and" || part.word == "or")
    {
      const bool decides = part.word == "or";
      for(const auto& each : part.parts)
      {
        if(holds(each, read) == decides)
        {
          return decides;
        }
      }
      return !decides;
    }
    const auto left = value(part.word == "key" ? part : part.parts[0], read);
    if(part.word == "key")
    {
      return left.cast<double>() != 0;
    }
    const auto right = value(part.parts[1], read);
    return left.isString() ? compared(left.cast<std::string>(), part.word, right.cast<std::string>()) :
                             compared(left.cast<double>(), part.word, right.cast<double>());
  }

  /// The value of a key, a text, a number or an operation.
  static BT::Any value(const Part& part, const Read& read)
  {
    if(part.word == "key")
    {
      return read(part.text);
    }
    if(part.parts.empty())
    {
      return part.word == "text" ? BT::Any(part.text) : BT::Any(part.number);
    }
    const auto left = value(part.parts[0], read).cast<double>();
    if(part.parts.size() == 1)
    {
      return BT::Any(-left);
    }
    const auto right = value(part.parts[1], read).cast<double>();
    return BT::Any(part.word == "+" ? left + right :
                   part.word == "-" ? left - right :
                   part.word == "*" ? left * right :
                                      left / right);
  }

  template <typename Value>
  static bool compared(const Value& left, const std::string& word, const Value& right)
  {
    if(word == "<") return left < right;
    if(word == "<=") return left <= right;
    if(word == ">") return left > right;
    if(word == ">=") return left >= right;
    if(word == "==") return left == right;
    return left != right;  // != and a flag, whose number is 0
  }

  Part joined(const std::string& by)
  {
    Part found{ by, "", 0, {} };
    do
    {
      found.parts.push_back(by == "or" ? joined("and") : term());
    } while(take(by));
    if(found.parts.size() == 1)
    {
      return Part(found.parts[0]);
    }
    for(const auto& part : found.parts)
    {
      condition(part);
    }
    return found;
  }

  Part term()
  {
    if(take("not"))
    {
      return { "not", "", 0, { condition(term()) } };
    }
    const auto left = sum();
    for(const std::string op : { "<", "<=", ">", ">=", "==", "!=" })
    {
      if(take(op))
      {
        return { op, "", 0, { left, sum() } };
      }
    }
    return left;
  }

  /// The part, unless it is a value that is compared with nothing.
  Part condition(const Part& part) const
  {
    const auto& word = part.word;
    if(word == "number" || word == "text" || std::string("+-*/").find(word) != std::string::npos)
    {
      fail();
    }
    return part;
  }

  Part sum()
  {
    auto found = product();
    while(word() == "+" || word() == "-")
    {
      const auto sign = word();
      take(sign);
      found = { sign, "", 0, { found, product() } };
    }
    return found;
  }

  Part product()
  {
    auto found = operand();
    while(word() == "*" || word() == "/")
    {
      const auto sign = word();
      take(sign);
      found = { sign, "", 0, { found, operand() } };
    }
    return found;
  }

  Part operand()
  {
    if(take("-"))
    {
      return { "-", "", 0, { operand() } };
    }
    if(take("("))
    {
      auto inside = joined("or");
      if(!take(")"))
      {
        fail();
      }
      return inside;
    }
    const auto name = word();
    const auto first = name.empty() ? ' ' : name[0];
    take(name);
    if(first == '\'')
    {
      return { "text", name.substr(1, name.size() - 2), 0, {} };
    }
    if(first == '_' || std::isalpha(static_cast<unsigned char>(first)))
    {
      return { "key", name, 0, {} };
    }
    std::istringstream number(name);
    number.imbue(std::locale::classic());
    double value = 0;
    if(!(number >> value) || !number.eof())
    {
      fail();
    }
    return { "number", "", value, {} };
  }

  /// The next word without consuming it; empty at the end.
  std::string word()
  {
    at_ = std::min(text_.find_first_not_of(" \t\n", at_), text_.size());
    if(at_ == text_.size())
    {
      return "";
    }
    if(text_[at_] == '\'')
    {
      return text_.substr(at_, std::min(text_.find('\'', at_ + 1), text_.size() - 1) + 1 - at_);
    }
    static const std::string operators = "<>=!";
    static const std::string signs = "()+-*/";
    const auto kind = [](char c) {
      return operators.find(c) != std::string::npos ? 1 : std::isspace(static_cast<unsigned char>(c)) ? 2 : 0;
    };
    if(signs.find(text_[at_]) != std::string::npos)
    {
      return text_.substr(at_, 1);
    }
    auto end = at_;
    while(end < text_.size() && kind(text_[end]) == kind(text_[at_]) &&
          signs.find(text_[end]) == std::string::npos)
    {
      end++;
    }
    return text_.substr(at_, end - at_);
  }

  bool take(const std::string& expected)
  {
    if(word() != expected)
    {
      return false;
    }
    at_ += expected.size();
    return true;
  }

  [[noreturn]] void fail() const
  {
    throw BT::RuntimeError("When: expected a condition such as battery < 25 and not found, found ",
                           text_);
  }

  std::string text_;
  std::size_t at_ = 0;
  Part whole_;
};

/// A guard: runs its child while a condition on the blackboard holds.
///
/// Attributes, read once when the tree is made:
///   condition  what must hold of blackboard entries, each a number, a bool or a text
///   abort      none: asked at the start only; self: also in each tick; lower: interrupts later
///              branches of the nearest InterruptibleFallback or -Sequence; both: the last two
class When : public BT::DecoratorNode
{
public:
  When(const std::string& name, const BT::NodeConfig& config)
    : BT::DecoratorNode(name, config), condition_(read("condition"))
  {
    const auto abort = read("abort");
    if(abort != "none" && abort != "self" && abort != "lower" && abort != "both")
    {
      throw BT::RuntimeError("When: expected abort none, self, lower or both, found ", abort);
    }
    stops_itself_ = abort == "self" || abort == "both";
    interrupts_ = abort == "lower" || abort == "both";
  }

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<std::string>("condition", "what must hold, e.g. battery < 25 and not found"),
             BT::InputPort<std::string>("abort", "both", "none, self, lower or both") };
  }

  /// True if the condition holds now.
  bool holds() const
  {
    return condition_.holds([this](const std::string& key) {
      const auto entry = config().blackboard->getAnyLocked(key);
      if(!entry || entry->empty())
      {
        throw BT::RuntimeError("When: the blackboard has no entry ", key,
                               "; set it before the first tick");
      }
      return *entry.get();
    });
  }

  bool interrupts() const
  {
    return interrupts_;
  }

  /// The last value of the condition; nothing: not checked since the composite started.
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

  std::string read(const std::string& port)
  {
    const auto found = getInput<std::string>(port);
    if(!found)
    {
      throw BT::RuntimeError("When: expected the attribute ", port, ": ", found.error());
    }
    return found.value();
  }

  Condition condition_;
  bool stops_itself_ = false;
  bool interrupts_ = false;
};

/// A Fallback or Sequence with memory that goes back to an earlier branch when a guard of that
/// branch becomes true. The running branch is halted before the other one starts.
///
/// `HandsOver` is the status of a child after which the next one starts.
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
      // From now on the guards of this branch are observed; their values at the start of the
      // branch may be outdated.
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

  /// The guards of all branches but the last, down to the first node that is not a decorator.
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

  /// The guards of that branch and of later ones are not observed until they are checked again.
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

  /// The branch of the first observed guard that became true, else the running branch.
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

/// Ticks every child that is not finished; then decides, failures first.
///
/// Attributes: success and failure, the children that decide: one, all or a number.
class JudgedParallel : public BT::ControlNode
{
public:
  JudgedParallel(const std::string& name, const BT::NodeConfig& config)
    : BT::ControlNode(name, config), success_(needed("success")), failure_(needed("failure"))
  {}

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<std::string>("success", "all", "how many must succeed: one, all or a number"),
             BT::InputPort<std::string>("failure", "one", "how many must fail: one, all or a number") };
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
    const bool fails = failed >= std::min(failure_, count);
    const bool succeeds = succeeded >= std::min(success_, count);
    if(!fails && !succeeds && succeeded + failed < count)
    {
      return BT::NodeStatus::RUNNING;
    }
    resetChildren();
    return succeeds && !fails ? BT::NodeStatus::SUCCESS : BT::NodeStatus::FAILURE;
  }

  std::size_t needed(const std::string& port)
  {
    const auto found = getInput<std::string>(port);
    const std::string word = found ? found.value() : "";
    if(word == "one" || word == "all")
    {
      return word == "one" ? 1 : static_cast<std::size_t>(-1);
    }
    if(word.empty() || word.size() > 9 || word.find_first_not_of("0123456789") != std::string::npos ||
       std::stoul(word) == 0)
    {
      throw BT::RuntimeError("JudgedParallel: expected one, all or a number as the attribute ", port);
    }
    return std::stoul(word);
  }

  std::size_t success_;
  std::size_t failure_;
  std::vector<BT::NodeStatus> results_;
};

/// Does one repetition a tick, until its child has ended a number of times with a given status.
/// Ends with the other status as soon as its child does.
class CountPerTick : public BT::DecoratorNode
{
protected:
  CountPerTick(const std::string& name, const BT::NodeConfig& config, const std::string& port,
               BT::NodeStatus counted)
    : BT::DecoratorNode(name, config), port_(port), counted_(counted)
  {}

private:
  BT::NodeStatus tick() override
  {
    if(status() != BT::NodeStatus::RUNNING)
    {
      const auto found = getInput<double>(port_);
      if(!found)
      {
        throw BT::RuntimeError(name(), ": expected a number as ", port_, ": ", found.error());
      }
      left_ = found.value();
      if(left_ < 1)
      {
        return counted_;
      }
    }
    setStatus(BT::NodeStatus::RUNNING);
    const auto result = child_node_->executeTick();
    if(result == BT::NodeStatus::RUNNING)
    {
      return result;
    }
    resetChild();
    if(result != counted_)
    {
      return result;
    }
    return --left_ < 1 ? counted_ : BT::NodeStatus::RUNNING;
  }

  std::string port_;
  BT::NodeStatus counted_;
  double left_ = 1;  // ends that count, still to come
};

/// Does one repetition a tick, until its child has succeeded num_cycles times. Fails with its child.
class RepeatPerTick : public CountPerTick
{
public:
  RepeatPerTick(const std::string& name, const BT::NodeConfig& config)
    : CountPerTick(name, config, "num_cycles", BT::NodeStatus::SUCCESS)
  {}

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<double>("num_cycles", "successes of the child that are needed") };
  }
};

/// Does one try a tick, until its child has failed num_attempts times. Succeeds with its child.
class RetryPerTick : public CountPerTick
{
public:
  RetryPerTick(const std::string& name, const BT::NodeConfig& config)
    : CountPerTick(name, config, "num_attempts", BT::NodeStatus::FAILURE)
  {}

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<double>("num_attempts", "failures of the child that end it") };
  }
};

/// Counts the ticks since its start, as many as the attribute `seconds` takes.
class CountsTicks : public BT::DecoratorNode
{
public:
  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<double>("seconds", "how long it lasts") };
  }

protected:
  /// `step_s`: the seconds between two ticks.
  CountsTicks(const std::string& name, const BT::NodeConfig& config, double step_s)
    : BT::DecoratorNode(name, config), step_s_(step_s)
  {
    if(!(step_s > 0))
    {
      throw BT::RuntimeError(name, ": expected register_nodes(factory, seconds) with those between two ticks");
    }
  }

  void count()
  {
    left_ = status() == BT::NodeStatus::RUNNING ? left_ - 1 : ticks();
    setStatus(BT::NodeStatus::RUNNING);
  }

  BT::NodeStatus tickChild()
  {
    const auto result = child_node_->executeTick();
    if(result != BT::NodeStatus::RUNNING)
    {
      resetChild();
    }
    return result;
  }

  double left_ = 0;  // ticks

private:
  double ticks()
  {
    const auto found = getInput<double>("seconds");
    if(!found)
    {
      throw BT::RuntimeError(name(), ": expected seconds: ", found.error());
    }
    const auto seconds = std::max(0.001, std::min(100000.0, found.value()));
    // 0.6 s are three ticks of 0.2 s, although 0.6 / 0.2 is not 3 in floating point.
    return std::max(1.0, std::ceil(seconds / step_s_ * (1 - 1e-12)));
  }

  double step_s_;
};

/// Starts its child some ticks after its own start.
class WaitTicks : public CountsTicks
{
public:
  WaitTicks(const std::string& name, const BT::NodeConfig& config, double step_s)
    : CountsTicks(name, config, step_s)
  {}

private:
  BT::NodeStatus tick() override
  {
    count();
    return left_ > 0 ? BT::NodeStatus::RUNNING : tickChild();
  }
};

/// Stops its child and fails if the child still runs some ticks after its start.
class TimeoutTicks : public CountsTicks
{
public:
  TimeoutTicks(const std::string& name, const BT::NodeConfig& config, double step_s)
    : CountsTicks(name, config, step_s)
  {}

private:
  BT::NodeStatus tick() override
  {
    count();
    if(left_ == 0)
    {
      resetChild();
      return BT::NodeStatus::FAILURE;
    }
    return tickChild();
  }
};

/// Makes the nodes known to a factory, under the names of the classes.
///
/// `step_s`: the seconds between two ticks, which WaitTicks and TimeoutTicks need.
inline void register_nodes(BT::BehaviorTreeFactory& factory, double step_s = 0)
{
  factory.registerNodeType<When>("When");
  factory.registerNodeType<InterruptibleFallback>("InterruptibleFallback");
  factory.registerNodeType<InterruptibleSequence>("InterruptibleSequence");
  factory.registerNodeType<JudgedParallel>("JudgedParallel");
  factory.registerNodeType<RepeatPerTick>("RepeatPerTick");
  factory.registerNodeType<RetryPerTick>("RetryPerTick");
  factory.registerNodeType<WaitTicks>("WaitTicks", step_s);
  factory.registerNodeType<TimeoutTicks>("TimeoutTicks", step_s);
}

}  // namespace islandgp
