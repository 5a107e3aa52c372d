"""ROS messages as bytes: serialising one by one is what costs most, so fixed layouts are patched with numpy."""
