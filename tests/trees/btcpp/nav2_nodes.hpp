// Reference models of four nodes of Nav2, on the real BehaviorTree.CPP, for the tests of exports.
//
// They follow what Nav2 publishes of PipelineSequence, RoundRobin (wrap_around), RecoveryNode and
// RateController; its code is not used. RateController counts ticks, one of which is a second.

#pragma once

#include <cmath>

#include "behaviortree_cpp/bt_factory.h"

namespace nav2_model
{
inline long now = 0;  // number of the tick

// Ticks its children from the first one in each tick. A running child ends the tick, unless a later
// one has been reached.
class PipelineSequence : public BT::ControlNode
{
public:
  PipelineSequence(const std::string& name, const BT::NodeConfig& config)
    : BT::ControlNode(name, config)
  {}
  static BT::PortsList providedPorts() { return {}; }
  void halt() override
  {
    reached_ = 0;
    BT::ControlNode::halt();
  }

private:
  BT::NodeStatus tick() override
  {
    for(std::size_t i = 0; i < childrenCount(); i++)
    {
      const auto status = children_nodes_[i]->executeTick();
      if(status == BT::NodeStatus::FAILURE) return ended(status);
      if(status == BT::NodeStatus::RUNNING && i >= reached_)
      {
        reached_ = i;
        return status;
      }
    }
    return ended(BT::NodeStatus::SUCCESS);
  }
  BT::NodeStatus ended(BT::NodeStatus status)
  {
    reached_ = 0;
    haltChildren();
    return status;
  }
  std::size_t reached_ = 0;
};

// Tries its children from its position on, around the end; a success moves the position behind it.
class RoundRobin : public BT::ControlNode
{
public:
  RoundRobin(const std::string& name, const BT::NodeConfig& config)
    : BT::ControlNode(name, config)
  {}
  static BT::PortsList providedPorts() { return { BT::InputPort<bool>("wrap_around") }; }
  void halt() override
  {
    position_ = failed_ = 0;
    BT::ControlNode::halt();
  }

private:
  BT::NodeStatus tick() override
  {
    for(; failed_ < childrenCount(); failed_++)
    {
      const auto status = children_nodes_[position_]->executeTick();
      if(status == BT::NodeStatus::RUNNING) return status;
      position_ = (position_ + 1) % childrenCount();
      if(status == BT::NodeStatus::SUCCESS)
      {
        failed_ = 0;
        haltChildren();
        return status;
      }
    }
    halt();
    return BT::NodeStatus::FAILURE;
  }
  std::size_t position_ = 0, failed_ = 0;
};

// A child, and what is run after its failure before it starts again, a number of times.
class RecoveryNode : public BT::ControlNode
{
public:
  RecoveryNode(const std::string& name, const BT::NodeConfig& config)
    : BT::ControlNode(name, config)
  {}
  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<unsigned>("number_of_retries") };
  }
  void halt() override
  {
    recovering_ = false;
    recoveries_ = 0;
    BT::ControlNode::halt();
  }

private:
  BT::NodeStatus tick() override
  {
    const auto most = getInput<unsigned>("number_of_retries").value();
    while(true)
    {
      const auto status = children_nodes_[recovering_ ? 1 : 0]->executeTick();
      if(status == BT::NodeStatus::RUNNING) return status;
      const bool succeeded = status == BT::NodeStatus::SUCCESS;
      const bool may_recover = recoveries_ < most;
      if(recovering_ ? !succeeded : succeeded || !may_recover)
      {
        halt();
        return status;
      }
      haltChild(recovering_ ? 1 : 0);
      recoveries_ += recovering_ ? 1 : 0;
      recovering_ = !recovering_;
    }
  }
  bool recovering_ = false;
  unsigned recoveries_ = 0;
};

// Starts its child at once after a reset, else no earlier than a period after its last success.
class RateController : public BT::DecoratorNode
{
public:
  RateController(const std::string& name, const BT::NodeConfig& config)
    : BT::DecoratorNode(name, config)
  {}
  static BT::PortsList providedPorts() { return { BT::InputPort<double>("hz") }; }

private:
  BT::NodeStatus tick() override
  {
    if(status() == BT::NodeStatus::IDLE) due_ = now;
    setStatus(BT::NodeStatus::RUNNING);
    if(child_node_->status() != BT::NodeStatus::RUNNING && now < due_) return status();
    const auto status = child_node_->executeTick();
    if(status != BT::NodeStatus::RUNNING) resetChild();
    if(status == BT::NodeStatus::SUCCESS)
    {
      const double seconds = 1 / getInput<double>("hz").value();
      due_ = now + std::max(1L, static_cast<long>(std::ceil(seconds - 1e-6)));
    }
    return status;
  }
  long due_ = 0;
};

inline void register_nodes(BT::BehaviorTreeFactory& factory)
{
  factory.registerNodeType<PipelineSequence>("PipelineSequence");
  factory.registerNodeType<RoundRobin>("RoundRobin");
  factory.registerNodeType<RecoveryNode>("RecoveryNode");
  factory.registerNodeType<RateController>("RateController");
}
}  // namespace nav2_model
