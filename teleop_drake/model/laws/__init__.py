"""Laws of control, contact and operators as pure functions of arrays, without Drake."""
