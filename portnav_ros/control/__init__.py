"""From setpoints to rudder and thrust."""
