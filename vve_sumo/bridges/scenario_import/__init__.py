"""What imports of scenarios of other formats share: XML of strangers, lines, what is not taken, a workspace's files."""
