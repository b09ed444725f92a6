"""The examples for ROS 2 with stand-ins for ROS's modules, which no registry has: python3 test_ros2.py"""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

FOLDER = Path(__file__).parent


def stand_in(name, **members):
    module = ModuleType(name)
    vars(module).update(members)
    sys.modules[name] = module


def point():
    return SimpleNamespace(x=0.0, y=0.0)


def message(**defaults):
    """A class of messages whose fields have these defaults."""
    return lambda **given: SimpleNamespace(**{name: make() for name, make in defaults.items()} | given)


def box():
    return SimpleNamespace(center=SimpleNamespace(position=point()), size_x=0.0, size_y=0.0)


def test_launch_file():
    stand_in("launch", LaunchDescription=list)
    stand_in(
        "launch.actions",
        DeclareLaunchArgument=lambda name, default_value, description: (name, default_value),
        ExecuteProcess=lambda cmd, output: cmd,
    )
    stand_in("launch.substitutions", LaunchConfiguration=lambda name: f"<{name}>")
    *arguments, command = runpy.run_path(str(FOLDER / "object_map.launch.py"))["generate_launch_description"]()
    words = ["".join(word) for word in command]
    assert words[:4] == ["quadlift-ros2", "--ros-args", "-r", "detections:=<detections>"], words
    assert all(any(f"<{name}>" in word for word in words) for name, _ in arguments), words


def test_conversion():
    hypothesis = message(hypothesis=lambda: SimpleNamespace(class_id="", score=0.0))
    detection = message(header=lambda: None, results=list, bbox=box, id=str)
    stand_in("rclpy")
    stand_in("rclpy.node", Node=None)
    stand_in("vision_msgs")
    stand_in(
        "vision_msgs.msg",
        Detection2D=detection,
        Detection2DArray=message(header=lambda: None, detections=list),
        ObjectHypothesisWithPose=hypothesis,
    )
    stand_in("yolo_msgs")
    stand_in("yolo_msgs.msg", DetectionArray=None)
    converted = runpy.run_path(str(FOLDER / "yolo_to_vision_msgs.py"))["converted"]
    bbox = SimpleNamespace(
        center=SimpleNamespace(position=SimpleNamespace(x=10.0, y=20.0)), size=SimpleNamespace(x=4.0, y=6.0)
    )
    found = SimpleNamespace(class_name="cup", score=0.9, id="7", bbox=bbox)
    result = converted(SimpleNamespace(header="header", detections=[found])).detections[0]
    assert (result.id, result.header) == ("7", "header")
    assert (result.bbox.center.position.x, result.bbox.size_y) == (10.0, 6.0)
    assert (result.results[0].hypothesis.class_id, result.results[0].hypothesis.score) == ("cup", 0.9)


if __name__ == "__main__":
    test_launch_file()
    test_conversion()
    print("the examples for ROS 2 are fine")
