"""What a viewer sees and does: cameras, their movement, input, time, lists of draws for user interfaces."""
