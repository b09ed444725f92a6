"""Starts an object map for a camera with a detector: ros2 launch object_map.launch.py detections:=/yolo/detections_2d

The program is that of `cargo install --path crates/quadlift-ros2`; it needs no package of ROS (docs/ros2.md).
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

ARGUMENTS = {
    "detections": ("/detections", "topic of vision_msgs/Detection2DArray"),
    "camera_info": ("/camera/camera_info", "topic of sensor_msgs/CameraInfo"),
    "world_frame": ("map", "frame in which objects are located"),
    "state_file": ("", "file of the map's state, from which it goes on"),
}


def generate_launch_description():
    chosen = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    node = ExecuteProcess(
        cmd=[
            "quadlift-ros2",
            "--ros-args",
            "-r", ["detections:=", chosen["detections"]],
            "-r", ["camera_info:=", chosen["camera_info"]],
            "-p", ["world_frame:=", chosen["world_frame"]],
            "-p", ["state_file:=", chosen["state_file"]],
            "-p", "resume:=true",
        ],
        output="screen",
    )
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, node])
