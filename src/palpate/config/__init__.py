"""Settings of the tracker: a group a factor or a stage."""
