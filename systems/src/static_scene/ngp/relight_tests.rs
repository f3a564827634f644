//! What renders in another light teach: the colour network what it says, everything else nothing.
