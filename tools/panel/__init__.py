"""The panel in the window: widgets for knobs, times, nodes and the frame graph."""
