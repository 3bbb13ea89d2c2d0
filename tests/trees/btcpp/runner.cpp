// Ticks trees in the real BehaviorTree.CPP and prints what their leaves are told.
//
// Standard input, word by word: a number of cases, then for each
//     once|exactly            the tick function
//     stateful|restarting     leaves of the library, or as Nav2's: they start again after their end
//     BYTES XML               the file, after its length
//     LEAVES NAME...
//     KEYS NAME b|d...        blackboard entries and their types
//     TICKS VALUE...          a value per key and tick
//     RESULTS F|S|R...        what leaves return, one after the other, again from the first
// Standard output: a line per tick, "A! B -C = RUNNING": started, resumed, halted; a line "." after
// each case. An error in a case is its only line: "error WHAT".

#include <cstring>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "islandgp_nodes.hpp"
#include "nav2_nodes.hpp"

namespace
{
struct Script
{
  std::vector<BT::NodeStatus> results;
  std::size_t taken = 0;
  std::string said;

  BT::NodeStatus call(const std::string& name, const char* mark)
  {
    said += name + mark + " ";
    return results[taken++ % results.size()];
  }
};

class Leaf : public BT::StatefulActionNode
{
public:
  Leaf(const std::string& name, const BT::NodeConfig& config, Script* script)
    : BT::StatefulActionNode(name, config), script_(script)
  {}
  static BT::PortsList providedPorts() { return {}; }
  BT::NodeStatus onStart() override { return script_->call(registrationName(), "!"); }
  BT::NodeStatus onRunning() override { return script_->call(registrationName(), ""); }
  void onHalted() override { script_->said += "-" + registrationName() + " "; }

private:
  Script* script_;
};

class RestartingLeaf : public BT::ActionNodeBase
{
public:
  RestartingLeaf(const std::string& name, const BT::NodeConfig& config, Script* script)
    : BT::ActionNodeBase(name, config), script_(script)
  {}
  static BT::PortsList providedPorts() { return {}; }
  BT::NodeStatus tick() override
  {
    const bool resumed = status() == BT::NodeStatus::RUNNING;
    return script_->call(registrationName(), resumed ? "" : "!");
  }
  void halt() override
  {
    if(status() == BT::NodeStatus::RUNNING) script_->said += "-" + registrationName() + " ";
    resetStatus();
  }

private:
  Script* script_;
};

void run_case()
{
  std::string how, kind;
  std::size_t bytes = 0, leaves = 0, keys = 0, ticks = 0, results = 0;
  std::cin >> how >> kind >> bytes;
  std::cin.get();
  std::string xml(bytes, ' ');
  std::cin.read(xml.data(), static_cast<std::streamsize>(bytes));
  Script script;
  std::cin >> leaves;
  std::vector<std::string> names(leaves);
  for(auto& name : names) std::cin >> name;
  std::cin >> keys;
  std::vector<std::pair<std::string, std::string>> entries(keys);
  for(auto& entry : entries) std::cin >> entry.first >> entry.second;
  std::cin >> ticks;
  std::vector<double> values(ticks * keys);
  for(auto& value : values) std::cin >> value;
  std::cin >> results;
  for(std::size_t i = 0; i < results; i++)
  {
    std::string word;
    std::cin >> word;
    script.results.push_back(word == "F" ? BT::NodeStatus::FAILURE :
                             word == "S" ? BT::NodeStatus::SUCCESS : BT::NodeStatus::RUNNING);
  }
  try
  {
    BT::BehaviorTreeFactory factory;
    islandgp::register_nodes(factory, 1.0);
    nav2_model::register_nodes(factory);
    for(const auto& name : names)
    {
      if(kind == "restarting") factory.registerNodeType<RestartingLeaf>(name, &script);
      else factory.registerNodeType<Leaf>(name, &script);
    }
    auto tree = factory.createTreeFromText(xml);
    for(std::size_t tick = 0; tick < ticks; tick++)
    {
      nav2_model::now = static_cast<long>(tick);
      for(std::size_t key = 0; key < keys; key++)
      {
        const double value = values[tick * keys + key];
        if(entries[key].second == "b")
        {
          tree.rootBlackboard()->set(entries[key].first, value != 0);
        }
        else
        {
          tree.rootBlackboard()->set(entries[key].first, value);
        }
      }
      const auto status = how == "once" ? tree.tickOnce() : tree.tickExactlyOnce();
      std::cout << script.said << "= " << BT::toStr(status) << "\n";
      script.said.clear();
    }
    script.said.clear();
    tree.haltTree();
  }
  catch(const std::exception& error)
  {
    std::cout << "error " << error.what() << "\n";
  }
  std::cout << "." << std::endl;
}
}  // namespace

int main()
{
  std::size_t cases = 0;
  while(std::cin >> cases)
  {
    for(std::size_t i = 0; i < cases; i++) run_case();
  }
}
