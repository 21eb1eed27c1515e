// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <mp700_ur5e_description/arm_pose.h>
#include <mp700_ur5e_description/robot_names.h>

#include "simulated_world/brick_sleep.h"
#include "simulated_world/differential_drive.h"
#include "simulated_world/mujoco_model.h"
#include "simulated_world/obstacle.h"
#include "simulated_world/physics_options.h"
#include "simulated_world/pile_scene.h"

namespace simulated_world {

using ArmVector = mp700_ur5e_description::ArmPose;
using mp700_ur5e_description::kArmJoints;
constexpr int kNumArmJoints = static_cast<int>(kArmJoints.size());

/// A brick as the world needs it: what physics does, and what is on its faces.
struct WorldBrick {
  BrickPlacement placement;
  double plate_edge_m{0.17};  ///< square steel plates in the middle of faces: the only places a magnet holds
  std::array<bool, 6> has_plate{{true, true, true, true, true, true}};  ///< faces +x, -x, +y, -y, +z, -z
  std::string material;                                                 ///< of the asset section; empty: plain colour
};

/// Flat magnet with a round face at the frame `magnet_tip`, z out of the tool.
struct MagnetConfig {
  double holding_force_N{90.0};
  double friction{0.35};
  double radius_m{0.03};
  double max_tilt_rad{0.12};

  static void fields(MagnetConfig& c, interactive_mapping::Fields& f) {
    f("holding_force_N", c.holding_force_N, 0.0, 1e4, "N", "pull-off force when the magnet is flat on the plate");
    f("friction", c.friction, 0.0, 2.0, "", "friction of tool on plate: sideways force per newton of remaining pull");
    f("radius_m", c.radius_m, 1e-3, 0.5, "m", "radius for the forces; the shape is the URDF's");
    f("max_tilt_rad", c.max_tilt_rad, 1e-3, 1.0, "rad",
      "angle between tool axis and the face's normal at which the force falls to zero");
  }
};

/// How stiffly arm and base follow their references.
struct ServoConfig {
  double arm_bandwidth_rad_s{80.0};
  ArmVector arm_effort_Nm{(ArmVector() << 150.0, 150.0, 150.0, 28.0, 28.0, 28.0).finished()};
  double base_bandwidth_rad_s{50.0};
  double traction_N{700.0};
  double max_slide_m{0.01};  ///< the reference stays so close to the body: a blocked base spins its wheels
  double max_slide_rad{0.02};
};

struct WorldConfig {
  PhysicsOptions physics;
  bool has_sleep{true};  ///< see BrickSleep
  BrickSleepConfig sleep;
  MagnetConfig magnet;
  ServoConfig servo;
  bool has_sun{false};           ///< light from one side, with shadows; else even light from the camera
  bool has_surroundings{false};  ///< sky, sun and a patterned ground for pictures, which cost drawing time; no physics

  // The parameters, by the sections that they have there.
  static void physicsFields(WorldConfig& c, interactive_mapping::Fields& f);
  static void armFields(WorldConfig& c, interactive_mapping::Fields& f);
  static void baseFields(WorldConfig& c, interactive_mapping::Fields& f);

  std::vector<std::string> validate() const;
};

/// Contact between a part of the robot and something else, the strongest since it was last asked for.
struct RobotTouch {
  std::string robot_body;  ///< a link, or the brick on the magnet
  std::string other_body;  ///< "ground", "brick_<id>" or another link
  int brick_id{-1};        ///< of other_body, or -1
  int load_id{-1};         ///< of robot_body, if that is the brick on the magnet, or -1
  double force_N{0.0};
  Eigen::Vector3d p_map{Eigen::Vector3d::Zero()};  ///< where it is greatest
};

/// Force and moment that the surroundings exert on the tool, in the frame ur5e_tool0, weight of tool and declared
/// payload taken out.
struct ToolWrench {
  Eigen::Vector3d force_N{Eigen::Vector3d::Zero()};
  Eigen::Vector3d torque_Nm{Eigen::Vector3d::Zero()};
};

struct BrickMotion {
  int id{0};
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d velocity_m_s{Eigen::Vector3d::Zero()};
};

/// Why a magnet let go.
enum class ReleaseReason { kSwitchedOff, kPulledOff, kFault };

/// The physics: robot, bricks and ground in MuJoCo, stepped by the caller. No ROS, no threads, no clock of its own;
/// the same calls give the same bits.
/// Long: every part reads and writes the one state that MuJoCo steps.
class World {
 public:
  /// `robot_mjcf`: body tree of the robot as made by robotMjcf(): a body `base_link` with the joints base_x, base_y and
  /// base_yaw, the arm's six joints, a body `magnet` and the sites magnet_tip and wrist_ft. `assets_mjcf`: textures
  /// and materials, may be empty. Throws std::invalid_argument for an impossible configuration or brick and
  /// std::runtime_error with MuJoCo's message.
  World(const std::string& robot_mjcf, const std::string& assets_mjcf, const std::vector<WorldBrick>& bricks,
        const Pose2d& robot_start, const ArmVector& arm_start_rad, const WorldConfig& config,
        const std::vector<Wall>& walls = {});

  /// One time step. Throws std::runtime_error when the state is no longer finite.
  void step();

  /// Brings the poses of bodies and cameras up to the state: a step leaves them where it began.
  void refreshPoses();

  /// Poses of all that moves as in `other`, a world of the same robot and bricks: to draw it with other surroundings.
  /// Throws std::invalid_argument if their states do not fit.
  void takePosesFrom(const World& other);

  double time() const { return data_->time; }
  const WorldConfig& config() const { return config_; }
  const mjModel& model() const { return *model_; }
  mjModel& mutableModel() { return *model_; }  ///< for textures, before a renderer is made
  const mjData& data() const { return *data_; }

  // References, held until the next call.
  void setArmReference(const ArmVector& position_rad, const ArmVector& velocity_rad_s,
                       const ArmVector& acceleration_rad_s2);
  void setBaseTwist(const Twist2d& twist_over_ground) { base_twist_ = twist_over_ground; }
  void setWheelAngles(double left_rad, double right_rad);
  void setMagnet(bool is_on);
  /// Share of the holding force that the magnet has, 1 when sound.
  void setMagnetStrength(double factor) { magnet_strength_ = factor; }
  /// Mass that the arm's controller expects beyond the tool (negative: less than the tool), and its centre in ur5e_tool0.
  void setPayload(double mass_kg, const Eigen::Vector3d& centre_m);

  // Of the tool itself; its centre in ur5e_tool0.
  double toolMass() const { return tool_mass_kg_; }
  const Eigen::Vector3d& toolCentre() const { return tool_centre_m_; }

  // Readings.
  ArmVector armPosition() const;
  ArmVector armVelocity() const;
  ArmVector armTorque() const { return arm_torque_; }
  /// Torque [N m] with which contacts and the held brick push the joints, in the last step.
  ArmVector armPush() const;
  /// Force [N] of all contacts on the tool but the held brick's, in the last step.
  double toolPush() const { return tool_push_N_; }
  ToolWrench toolWrench() const;
  Pose2d basePose() const;                                    ///< of base_link in the map
  Twist2d baseTwist() const;                                  ///< true velocity, along and about the base's own axes
  Eigen::Isometry3d linkPose(const std::string& link) const;  ///< T_map_link; throws std::invalid_argument
  std::vector<BrickMotion> bricks() const;                    ///< those that have not been taken away, in order of id
  std::optional<BrickMotion> brick(int id) const;
  std::optional<int> heldBrick() const;
  /// Why and what the magnet last let go, once.
  struct Release {
    int brick_id;
    ReleaseReason reason;
    std::string load;  // of kPulledOff: what was more than the magnet holds
  };
  std::optional<Release> takeRelease();
  /// Contacts of the robot since the last call, one per pair of bodies, in a fixed order.
  std::vector<RobotTouch> takeTouches();
  int numAwake() const;     ///< bricks that take part in the dynamics now
  int numContacts() const;  ///< points of contact that the last step has solved
  /// A brick whose middle is over the container's floor, less than half a metre over the rim.
  struct StowedBrick {
    int id;
    bool is_at_rest;  ///< with respect to the container
    bool is_seated;   ///< lies flat on its floor; at rest and not seated: on the rim, or on other bricks
  };
  /// Those that are not held.
  std::vector<StowedBrick> bricksInContainer() const;

  // What a person or a fault does.
  /// What a brick would be inside of at a pose, by more than 5 mm: "ground", a link or a brick; empty: it is free. Throws
  /// std::invalid_argument for an unknown id or a pose that is not finite or not within 100 m.
  std::string obstacleAt(int id, const Eigen::Isometry3d& T_map_brick);
  bool knowsBrick(int id) const;  ///< there, or taken away
  /// Puts a brick somewhere, at rest; one that was taken away is there again. Throws std::invalid_argument for an unknown id
  /// or a pose that is not finite.
  void moveBrick(int id, const Eigen::Isometry3d& T_map_brick);
  /// Takes a brick out of the world. Throws std::invalid_argument if it is not there.
  void takeAwayBrick(int id);
  /// What an obstacle on this place of the ground would be inside of, by more than 5 mm: a link, a brick or another
  /// obstacle; empty: it is free. Throws std::invalid_argument for a place that is not finite or not within 100 m.
  std::string thingAt(const Eigen::Vector2d& xy_map);
  /// Puts an obstacle there, whatever is in its place, and returns its index. Throws std::invalid_argument as thingAt()
  /// and std::logic_error if kMaxObstacles stand already.
  int addObstacle(const Eigen::Vector2d& xy_map);
  /// Throws std::invalid_argument if it does not stand.
  void takeAwayObstacle(int index);
  std::vector<Obstacle> obstacles() const;  ///< that stand, in order of index
  /// The magnet loses its brick though it is switched on; it takes none until it is switched off. False if it held none.
  bool dropHeldBrick();

  /// Fingerprint of the complete state: equal runs have equal ones.
  std::uint64_t digest() const;

 private:
  struct BrickSlot {
    WorldBrick brick;
    int body;
    int geom;
    int qpos;
    int dof;
    bool is_present{true};
  };

  struct ObstacleSlot {
    int geom;
    int mocap;  // index of a body that stays where it is put
    bool is_present{false};
  };

  // Of the constructor: ids and addresses in the model, then the start.
  void findRobot();
  void findBricks(const std::vector<WorldBrick>& bricks);
  void findObstacles();
  void findContainer();  ///< there may be none
  void standAt(const Pose2d& robot_start, const ArmVector& arm_start_rad);
  void weighTool();  ///< of all that hangs on the wrist's sensor

  void commandBase();
  void commandArm();
  void updateMagnet();
  void collectTouches();
  void keepStoredBricks();
  void letGo(ReleaseReason reason, const std::string& load = "");
  /// Net force [N] and moment about the tip [N m] that the tool exerts on the held brick, in the map frame.
  void toolOnBrick(const BrickSlot& slot, Eigen::Vector3d& force, Eigen::Vector3d& moment) const;
  double holdFactor(const BrickSlot& slot) const;
  std::size_t indexOf(int id) const;
  void setWeld(bool is_active);
  void placeObstacle(ObstacleSlot& slot, bool is_present, const Eigen::Vector3d& base_map);

  WorldConfig config_;
  ModelPtr model_;
  DataPtr data_;
  std::unique_ptr<BrickSleep> sleep_;  // null: nobody sleeps
  std::vector<BrickSlot> slots_;
  std::vector<ObstacleSlot> obstacles_;
  std::vector<int> slot_of_geom_;  // index into slots_, -1
  std::vector<char> is_robot_geom_;
  std::vector<char> is_magnet_geom_;
  std::array<int, kNumArmJoints> arm_qpos_{};
  std::array<int, kNumArmJoints> arm_dof_{};
  std::array<int, 3> base_qpos_{};
  std::array<int, 3> base_dof_{};
  std::array<int, 2> wheel_qpos_{{-1, -1}};
  std::array<int, 2> wheel_dof_{{-1, -1}};
  int magnet_body_{-1};
  int container_body_{-1};
  Eigen::AlignedBox3d container_inside_;  // hull of its walls, in the container's frame
  int tip_site_{-1};
  int wrist_site_{-1};
  int force_sensor_{-1};
  int torque_sensor_{-1};
  int weld_{-1};
  double tool_mass_kg_{0.0};
  Eigen::Vector3d tool_centre_m_{Eigen::Vector3d::Zero()};  // in the wrist site's frame

  ArmVector arm_reference_{ArmVector::Zero()};
  ArmVector arm_reference_velocity_{ArmVector::Zero()};
  ArmVector arm_reference_acceleration_{ArmVector::Zero()};
  ArmVector arm_torque_{ArmVector::Zero()};
  double tool_push_N_{0.0};
  Pose2d base_reference_;
  Twist2d base_twist_;
  Twist2d previous_base_twist_;
  double payload_kg_{0.0};
  Eigen::Vector3d payload_centre_m_{Eigen::Vector3d::Zero()};
  bool is_magnet_on_{false};
  bool is_magnet_spent_{false};  // lost its brick: holds nothing until switched off and on
  double magnet_strength_{1.0};
  int held_{-1};             // index into slots_
  double hold_factor_{0.0};  // of the magnet's force on the held brick, by how it sits on it
  int overload_steps_{0};
  std::optional<Release> release_;
  std::vector<RobotTouch> touches_;
};

}  // namespace simulated_world
