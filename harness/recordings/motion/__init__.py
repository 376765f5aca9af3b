"""Motion of one rigid body: kinematics between its signals, and how far two signals of one quantity agree."""
