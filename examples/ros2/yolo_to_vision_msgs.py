"""A node that publishes the detections of yolo_ros as vision_msgs: /yolo/tracking in, /yolo/detections_2d out.

Needs rclpy, vision_msgs and yolo_msgs, which come with ROS 2 and yolo_ros: python3 yolo_to_vision_msgs.py
"""

import rclpy
from rclpy.node import Node
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose
from yolo_msgs.msg import DetectionArray


def converted(array):
    """The same detections as a vision_msgs/Detection2DArray; the ids are those of the tracker."""
    result = Detection2DArray(header=array.header)
    for found in array.detections:
        detection = Detection2D(header=array.header, id=found.id)
        detection.bbox.center.position.x = found.bbox.center.position.x
        detection.bbox.center.position.y = found.bbox.center.position.y
        detection.bbox.size_x = found.bbox.size.x
        detection.bbox.size_y = found.bbox.size.y
        hypothesis = ObjectHypothesisWithPose()
        hypothesis.hypothesis.class_id = found.class_name
        hypothesis.hypothesis.score = found.score
        detection.results.append(hypothesis)
        result.detections.append(detection)
    return result


def main():
    rclpy.init()
    node = Node("yolo_to_vision_msgs")
    publisher = node.create_publisher(Detection2DArray, "/yolo/detections_2d", 10)
    node.create_subscription(DetectionArray, "/yolo/tracking", lambda array: publisher.publish(converted(array)), 10)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
